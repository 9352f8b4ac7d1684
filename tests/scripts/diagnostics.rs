//! Wrong scripts: each gives the right code at the right place with the right help, and looks right in a terminal.
//! `UPDATE_EXPECT=1 cargo test --test scripts diagnostics::` rewrites the pictures in `tests/scripts/diagnostics/`.

mod expectations;
mod kinds;
mod lints;
mod materials;
mod records;

use std::path::Path;

use dscene::check::{Disk, check_text};
use dscene::diag::{RenderOptions, render_all};

/// A scene that the scripts build on, where they need one.
const SCENE: &str = "\
camera eye { position: [0, 1, -4], look_at: [0, 0, 0], fov: 45deg, film: [64, 64] }
material grey = diffuse(reflectance: 0.5)
param size = 1
shape ball { mesh: sphere(radius: size), material: grey }
light lamp = area(rectangle() |> flip() |> translate([0, 3, 0]), radiance: 10)
let target = render(eye, spp: 64) with { size: 0.5 }
loss fit = mse(render(eye), target)
";

struct Case {
    name: &'static str,
    /// Put before the script.
    prelude: &'static str,
    script: &'static str,
    /// Code, text under the first label, part of a help: one entry for each diagnostic, in order.
    wanted: &'static [(&'static str, &'static str, &'static str)],
}

fn cases() -> impl Iterator<Item = &'static Case> {
    CASES
        .iter()
        .chain(expectations::CASES)
        .chain(kinds::CASES)
        .chain(lints::CASES)
        .chain(materials::CASES)
        .chain(records::CASES)
}

const CASES: &[Case] = &[
    Case {
        name: "unknown_name",
        prelude: SCENE,
        script: "loss other = mse(render(eye), tarqet)",
        wanted: &[("dscene::name::unknown", "tarqet", "did you mean `target`?")],
    },
    Case {
        name: "unknown_field",
        prelude: SCENE,
        script: "camera side { positon: [4, 0, 0], fov: 45deg }",
        wanted: &[("dscene::name::field", "positon", "did you mean `position`?")],
    },
    Case {
        name: "foreign_field",
        prelude: "",
        script: "shape a { mesh: cube(), bsdf: diffuse(albedo: 0.5) }\nlight l = area(disk(), emission: 4)",
        wanted: &[
            ("dscene::name::field", "bsdf", "did you mean `material`?"),
            ("dscene::call::unknown_argument", "albedo", "did you mean `reflectance`?"),
            ("dscene::call::unknown_argument", "emission", "did you mean `radiance`?"),
        ],
    },
    Case {
        name: "words_as_names",
        prelude: "",
        script: "shape print { mesh: cube() }\nlet save = 3\nparam for = 3\nfn if(x) = x\ncamera report { film: [4, 4] }",
        wanted: &[
            ("dscene::syntax::unexpected", "print", "cannot be a name"),
            ("dscene::syntax::unexpected", "save", "cannot be a name"),
            ("dscene::syntax::unexpected", "for", "cannot be a name"),
            ("dscene::syntax::unexpected", "if", "cannot be a name"),
            ("dscene::syntax::unexpected", "report", "cannot be a name"),
        ],
    },
    Case {
        name: "missing_unit",
        prelude: "",
        script: "camera eye { position: [0, 0, 5], fov: 45 }",
        wanted: &[("dscene::type::unit", "45", "`45deg`")],
    },
    Case {
        name: "unknown_unit",
        prelude: "",
        script: "let a = 45degrees",
        wanted: &[("dscene::syntax::unit", "45degrees", "write `45deg`")],
    },
    Case {
        name: "angle_for_a_number",
        prelude: "",
        script: "let a = sqrt(2) + 45deg\nmesh ball = sphere(radius: 45deg)",
        wanted: &[("dscene::type::mismatch", "+", "1deg"), ("dscene::type::unit", "45deg", "45deg / 1deg")],
    },
    Case {
        name: "image_sizes",
        prelude: "",
        script: "\
camera small { film: [256, 256], fov: 45deg }
camera large { film: [512, 512], fov: 45deg }
param height = 1
shape ball { mesh: sphere() |> translate([0, height, 0]) }
light sky = constant(1)
let target = render(large, spp: 64) with { height: 0 }
loss fit = mse(render(small), target)",
        wanted: &[("dscene::type::shape", "target", "same `film:`")],
    },
    Case {
        name: "image_sizes_in_an_operator",
        prelude: SCENE,
        script: "camera wide { film: [128, 64], fov: 45deg }\nlet d = render(eye) - render(wide)",
        wanted: &[("dscene::type::shape", "-", "")],
    },
    Case {
        name: "cycle",
        prelude: "",
        script: "let a = b + 1\nlet b = c * 2\nlet c = a",
        wanted: &[("dscene::name::cycle", "a", "graph of values")],
    },
    Case {
        name: "recursive_function",
        prelude: "",
        script: "fn fact(n) = if n < 2 then 1 else n * fact(n - 1)",
        wanted: &[("dscene::name::cycle", "fact", "comprehension")],
    },
    Case {
        name: "scene_that_renders_itself",
        prelude: SCENE,
        script: "shape screen { mesh: rectangle(), material: diffuse(reflectance: texture(render(eye))) }",
        wanted: &[("dscene::name::cycle", "screen", "scene of its own")],
    },
    Case {
        name: "loss_is_an_image",
        prelude: SCENE,
        script: "loss bad = render(eye) - target",
        wanted: &[("dscene::type::loss", "render(eye) - target", "mse(image, target)")],
    },
    Case {
        name: "unused_param",
        prelude: SCENE,
        script: "param roughness = 0.3\nmaterial metal = conductor(roughness: roughness)",
        wanted: &[("dscene::flow::unused_param", "roughness", "`roughness` feeds `metal`, but no shape uses `metal`")],
    },
    Case {
        name: "param_used_by_nothing",
        prelude: SCENE,
        script: "param shift = [0, 0, 0]",
        wanted: &[("dscene::flow::unused_param", "shift", "nothing uses `shift`")],
    },
    Case {
        name: "loss_without_params",
        prelude: "",
        script: "camera eye { fov: 45deg }\nshape ball { mesh: sphere() }\nloss fit = mean(render(eye))",
        wanted: &[("dscene::flow::constant_loss", "fit", "param NAME")],
    },
    Case {
        name: "bounds_exclude_the_start",
        prelude: "",
        script: "param albedo: color = [0.5, 1.5, 0.2] in 0..1",
        wanted: &[("dscene::type::bounds", "[0.5, 1.5, 0.2]", "start inside")],
    },
    Case {
        name: "empty_bounds",
        prelude: "",
        script: "param a = 0.5 in 1..0\nparam turn = 10deg in 0..90",
        wanted: &[
            ("dscene::type::bounds", "1..0", "lo < hi"),
            ("dscene::type::bounds", "0..90", "write `0deg..90deg`"),
        ],
    },
    Case {
        name: "wrong_reader",
        prelude: "",
        script: "mesh photo = load(\"photo.png\")\nlet bunny = load_image(\"bunny.obj\")\nlet scan = image(\"scan.exr\")",
        wanted: &[
            ("dscene::file::format", "\"photo.png\"", "write `load_image(\"photo.png\")`"),
            ("dscene::file::format", "\"bunny.obj\"", "write `load(\"bunny.obj\")`"),
            ("dscene::type::mismatch", "\"scan.exr\"", "`load_image(\"scan.exr\")`"),
        ],
    },
    Case {
        name: "missing_file",
        prelude: "",
        script: "mesh bunny = load(\"meshes/bunny.obj\")\nlet photo = load_image(\"photo.png\")",
        wanted: &[
            ("dscene::file::missing", "\"meshes/bunny.obj\"", "folder of the script"),
            ("dscene::file::missing", "\"photo.png\"", "folder of the script"),
        ],
    },
    Case {
        name: "missing_import",
        prelude: "",
        script: "import \"lib/nothing.dscene\"\nimport std.studoi",
        wanted: &[
            ("dscene::import::missing", "import \"lib/nothing.dscene\"", ""),
            ("dscene::import::missing", "std.studoi", "`std.studio`"),
        ],
    },
    Case {
        name: "unclosed_brace",
        prelude: "",
        script: "camera eye {\n  position: [0, 0, 5]\n  fov: 45deg\n\nshape ball { mesh: sphere() }\nlet a = nothing",
        wanted: &[
            ("dscene::syntax::unclosed", "{", "add the missing `}`"),
            ("dscene::name::unknown", "nothing", "declare it"),
        ],
    },
    Case {
        name: "unread_declarations_are_not_missed",
        prelude: "",
        script: "let a = (1 + 2\nlet b = [1, 2\nlet c = b + d * a",
        wanted: &[
            ("dscene::syntax::unclosed", "(", "add the missing `)`"),
            ("dscene::syntax::unclosed", "[", "add the missing `]`"),
            ("dscene::name::unknown", "d", ""),
        ],
    },
    Case {
        name: "wrong_closing_bracket",
        prelude: "",
        script: "let a = [1, 2, 3)\nlet b = 1",
        wanted: &[("dscene::syntax::unclosed", ")", "")],
    },
    Case {
        name: "unclosed_string",
        prelude: "",
        script: "let a = \"abc\nlet b = 1",
        wanted: &[("dscene::syntax::unclosed_string", "\"abc", "end it with `\"`")],
    },
    Case {
        name: "wrong_argument",
        prelude: "",
        script: "mesh a = sphere(radius: \"big\")\nshape b { mesh: sphere(), material: 0.5 }\nlet c = render(sphere())",
        wanted: &[
            ("dscene::type::mismatch", "\"big\"", ""),
            ("dscene::type::mismatch", "0.5", "diffuse(reflectance: 0.5)"),
            ("dscene::type::mismatch", "sphere()", ""),
        ],
    },
    Case {
        name: "missing_argument",
        prelude: "",
        script: "light l = point(intensity: 4)\nshape s { material: mirror() }",
        wanted: &[
            ("dscene::call::missing", "point", "position: …"),
            ("dscene::call::missing", "shape", "add `mesh: …`"),
        ],
    },
    Case {
        name: "too_many_arguments",
        prelude: "",
        script: "let a = sin(1deg, 2deg)",
        wanted: &[("dscene::call::count", "2deg", "sin(x: angles)")],
    },
    Case {
        name: "duplicate_argument",
        prelude: "",
        script: "camera eye { fov: 45deg, film: [8, 8], fov: 30deg }\nlet a = sphere(1, radius: 2)",
        wanted: &[("dscene::call::duplicate", "fov", ""), ("dscene::call::duplicate", "radius", "")],
    },
    Case {
        name: "duplicate_declaration",
        prelude: "",
        script: "let a = 1\nlet a = 2",
        wanted: &[("dscene::name::duplicate", "a", "another name")],
    },
    Case {
        name: "annotation_differs",
        prelude: "",
        script: "param corners: vec3[4] = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]",
        wanted: &[("dscene::type::mismatch", "[[0, 0, 0], [1, 0, 0], [0, 1, 0]]", "")],
    },
    Case {
        name: "ragged_array",
        prelude: "",
        script: "let a = [[0, 0, 0], [1, 0], [0, 1, 0]]",
        wanted: &[("dscene::type::shape", "[1, 0]", "same shape")],
    },
    Case {
        name: "chained_comparison",
        prelude: "",
        script: "let x = 0.5\nexpect 0 < x < 1",
        wanted: &[("dscene::syntax::chained_comparison", "<", "a < b and b < c")],
    },
    Case {
        name: "unknown_statement",
        prelude: "",
        script: "camra eye { fov: 45deg }\nvar x = 1\nlet y = 2",
        wanted: &[
            ("dscene::syntax::unknown_statement", "camra", "did you mean `camera`?"),
            ("dscene::syntax::unknown_statement", "var", "write `let x = 1`"),
        ],
    },
    Case {
        name: "missing_expression",
        prelude: "",
        script: "let a =\nlet b = 1 +\nlet c = (1, 2)",
        wanted: &[
            ("dscene::syntax::unexpected", "=", "expression is missing"),
            ("dscene::syntax::unexpected", "+", "expression is missing"),
            ("dscene::syntax::unexpected", ",", ""),
        ],
    },
    Case {
        name: "equals_for_a_colon",
        prelude: "",
        script: "camera eye { fov = 45deg }",
        wanted: &[("dscene::syntax::unexpected", "=", "a colon: `fov: 45deg`")],
    },
    Case {
        name: "unknown_type",
        prelude: "",
        script: "let a: float = 1\nfn f(x: vec5) = x",
        wanted: &[
            ("dscene::type::unknown", "float", "did you mean `scalar`?"),
            ("dscene::type::unknown", "vec5", "did you mean"),
        ],
    },
    Case {
        name: "index_out_of_range",
        prelude: "",
        script: "let a = [1, 2, 3]\nlet b = a[3]\nlet c = a.w",
        wanted: &[("dscene::type::index", "3", "count from 0"), ("dscene::name::field", "w", "")],
    },
    Case {
        name: "kind_is_another",
        prelude: "",
        script: "shape a = sphere()\nmaterial b = area(disk())\nmaterial c { reflectance: 0.5 }",
        wanted: &[
            ("dscene::type::mismatch", "sphere()", "give it a material"),
            ("dscene::type::mismatch", "area(disk())", "declare it with `light`"),
            ("dscene::name::unknown", "material", "diffuse(…)"),
        ],
    },
    Case {
        name: "optimize_fields",
        prelude: SCENE,
        script: "optimize fit { optimizer: adam(learning_rate: 0.1), iterations: 10, over: [target] }",
        wanted: &[
            ("dscene::name::field", "optimizer", "did you mean `using`?"),
            ("dscene::call::unknown_argument", "learning_rate", "did you mean `lr`?"),
            ("dscene::name::field", "iterations", "did you mean `steps`?"),
            ("dscene::type::param", "target", "param target"),
        ],
    },
    Case {
        name: "wrong_choice",
        prelude: "",
        script: "camera eye { kind: orthografic }",
        wanted: &[("dscene::name::unknown", "orthografic", "did you mean `orthographic`?")],
    },
    Case {
        name: "gradient_of_an_image",
        prelude: SCENE,
        script: "print grad(render(eye), size), grad(fit, lamp), grad(fit, sized), jacobian(render(eye), [])",
        wanted: &[
            ("dscene::type::loss", "render(eye)", "jacobian(e, p)"),
            ("dscene::type::param", "lamp", "`lamp.radiance`"),
            ("dscene::name::unknown", "sized", "did you mean `size`?"),
            ("dscene::type::param", "[]", ""),
        ],
    },
    Case {
        name: "with_of_nothing",
        prelude: SCENE,
        script: "let a = render(eye) with { radius: 2, lamp.power: 3, eye: 4 }",
        wanted: &[
            ("dscene::name::unknown", "radius", ""),
            ("dscene::name::field", "power", "did you mean `radiance`?"),
            ("dscene::type::mismatch", "4", ""),
        ],
    },
    Case {
        name: "values_that_cannot_be",
        prelude: "",
        script: "camera a { film: [0, 64], fov: 180deg }\ncamera b { film: [100000, 100000], position: [0, 0, 0] }\nlet c = render(a, spp: 0)",
        wanted: &[
            ("dscene::value::film", "[0, 64]", "at least 1"),
            ("dscene::value::fov", "180deg", ""),
            ("dscene::value::film", "[100000, 100000]", ""),
            ("dscene::value::spp", "0", "spp: 1"),
        ],
    },
    Case {
        name: "error_in_a_function",
        prelude: "",
        script: "fn twice(x) = x + [1, 2]\nlet a = twice([1, 2, 3])\nlet b: scalar = mix(1, \"a\", 0.5)",
        wanted: &[("dscene::type::shape", "+", ""), ("dscene::type::mismatch", "\"a\"", "")],
    },
    Case {
        name: "saving",
        prelude: SCENE,
        script: "save eye to \"a.png\"\nsave render(eye) to \"a.bmp\"\nsave render(eye) to 3\n\
                 save ball.mesh to \"a.stl\"\nsave size to \"a.png\"\nplot fit, target",
        wanted: &[
            ("dscene::file::format", "\"a.png\"", "save render(eye)"),
            ("dscene::file::format", "\"a.bmp\"", "`.png`"),
            ("dscene::type::mismatch", "3", ""),
            ("dscene::file::format", "\"a.stl\"", "`.ply`"),
            ("dscene::file::format", "\"a.png\"", "`.json`"),
            ("dscene::type::mismatch", "target", "save EXPR to"),
        ],
    },
    Case {
        name: "two_fields_of_view",
        prelude: "",
        script: "camera eye { fov: 45deg, fov_x: 60deg }",
        wanted: &[("dscene::value::fov", "60deg", "leave one of them out")],
    },
    Case {
        name: "focal_lengths",
        prelude: "",
        script: "camera a { fov: 45deg, focal: 50 }\ncamera b { sensor_width: 36 }\ncamera c { kind: fisheye, focal: 50 }\n\
                 camera d { principal: [30, 20], distortion: [0.1] }",
        wanted: &[
            ("dscene::value::focal", "50", "leave one of them out"),
            ("dscene::value::focal", "36", "focal: 35, sensor_width: 36"),
            ("dscene::value::focal", "50", "leave it out"),
            ("dscene::value::focal", "[30, 20]", "undistort"),
        ],
    },
    Case {
        name: "filters",
        prelude: "",
        script: "camera a { filter: lanczos }\ncamera b { kind: panorama, filter: tent }\ncamera c { kind: panorama, filter: box }",
        wanted: &[("dscene::name::unknown", "lanczos", "mitchell"), ("dscene::value::filter", "tent", "larger film")],
    },
    Case {
        name: "crops",
        prelude: "",
        script: "camera a { film: [64, 64], crop: [32, 32, 96, 64] }\ncamera b { crop: [9, 9, 9, 12] }\n\
                 camera c { film: [64, 64], window: [0, 0, 9, 9] }",
        wanted: &[
            ("dscene::value::crop", "[32, 32, 96, 64]", "upper left corner"),
            ("dscene::value::crop", "[9, 9, 9, 12]", "x0 < x1"),
            ("dscene::name::field", "window", "did you mean `crop`?"),
        ],
    },
    Case {
        name: "lenses_and_shutters",
        prelude: "",
        script: "camera a { aperture: -0.1, focus: 0 }\ncamera b { kind: fisheye, aperture: 0.1 }\n\
                 camera c { shutter: [0.6, 0.4] }\ncamera d { shutter: [0, 2] }\nlet m = moving(sphere())",
        wanted: &[
            ("dscene::value::aperture", "-0.1", "radius of the lens"),
            ("dscene::value::focus", "0", "distance along the viewing direction"),
            ("dscene::value::aperture", "0.1", "leave it out"),
            ("dscene::value::shutter", "[0.6, 0.4]", "shutter: [0, 0.5]"),
            ("dscene::value::shutter", "[0, 2]", ""),
            ("dscene::call::missing", "moving", "closing"),
        ],
    },
    Case {
        name: "spots_and_distortion",
        prelude: "",
        script: "let wide = spot(position: [0, 2, 0], direction: [0, -1, 0], cutoff: 200deg)\n\
                 let sharp = spot(position: [0, 2, 0], direction: [0, -1, 0], cutoff: 30deg, beam: 30deg)\n\
                 let other = spot(position: [0, 2, 0], direction: [0, -1, 0], beam_width: 3deg)\n\
                 camera a { distortion: [0, 0, 0, 0, 0, 1] }\ncamera b { kind: panorama, distortion: [-0.1] }\n\
                 camera c { distortion: [-0.1], aperture: 0.1 }\ncamera d { distortion: 0.1 }",
        wanted: &[
            ("dscene::value::range", "200deg", "at most `180deg`"),
            ("dscene::value::cone", "30deg", "without `beam`"),
            ("dscene::call::unknown_argument", "beam_width", "`beam`"),
            ("dscene::value::distortion", "[0, 0, 0, 0, 0, 1]", "k1, k2, p1, p2, k3"),
            ("dscene::value::distortion", "[-0.1]", "leave it out"),
            ("dscene::value::distortion", "[-0.1]", "leave one of them out"),
            ("dscene::type::mismatch", "0.1", "write `[0.1]`"),
        ],
    },
    Case {
        name: "index_by_a_colon",
        prelude: "",
        script: "let rows = [[1, 2], [3, 4]]\nlet a = rows[0, 1]\nlet b = rows[0:1]\nlet c = rows[0..1, 2]",
        wanted: &[("dscene::syntax::unexpected", "0:1", "`0..1`"), ("dscene::type::index", "2", "count from 0")],
    },
    Case {
        name: "keyframes_of_different_things",
        prelude: "",
        script: "let ball = sphere()\nlet a = moving(ball, camera(position: [0, 0, 5], look_at: [0, 0, 0]))\n\
                 let b = moving(camera(position: [0, 0, 5], look_at: [0, 0, 0], film: [64, 32]), camera(position: [0, 1, 5], look_at: [0, 0, 0]))\n\
                 let c = moving(0.5, 0.7)",
        wanted: &[
            ("dscene::type::mismatch", "camera(position: [0, 0, 5], look_at: [0, 0, 0])", "same thing in two places"),
            ("dscene::type::shape", "camera(position: [0, 1, 5], look_at: [0, 0, 0])", "the same `film`"),
            ("dscene::type::mismatch", "0.5", ""),
            ("dscene::type::mismatch", "0.7", ""),
        ],
    },
    Case {
        name: "too_many_triangles",
        prelude: "",
        script: "let ball = sphere(subdivisions: 4096)\nlet land = grid(columns: 10000, rows: 10000)\nlet fine = grid(columns: 2000, rows: 2000)",
        wanted: &[
            ("dscene::value::triangles", "4096", "coarser"),
            ("dscene::value::triangles", "10000, rows: 10000", ""),
        ],
    },
    Case {
        name: "priors",
        prelude: "",
        script: "param a ~ normal(0, 0)\nparam b = 30deg ~ normal(0, 5)\nparam c: vec3 ~ normal([0, 1], 0.1)\nparam d ~ gaussian(0, 1)\n\
                 param e = 3 ~ 4\nparam f: rotation = euler(y: 20deg) ~ normal(0, 1)\nlet g = 3\nparam h = 2\n\
                 let i = prior(g) + prior(h) + prior(a + 1)\nparam j ~ uniform(2, 1)\nparam k = 2 ~ normal([0, 1], 1)",
        wanted: &[
            ("dscene::value::range", "0", "more than"),
            ("dscene::type::prior", "normal(0, 5)", "angles too"),
            ("dscene::type::mismatch", "normal([0, 1], 0.1)", "an initial value"),
            ("dscene::name::unknown", "gaussian", "`normal`"),
            ("dscene::type::prior", "4", "~ normal(4, sd)"),
            ("dscene::type::prior", "normal(0, 1)", "rotations have no priors"),
            ("dscene::name::prior", "g", "`prior(g, normal(mean, sd))`"),
            ("dscene::name::prior", "h", "`param h = 2 ~ normal(mean, sd)`"),
            ("dscene::name::prior", "a + 1", "normal(mean, sd)"),
            ("dscene::value::range", "1", "low < high"),
            ("dscene::type::prior", "normal([0, 1], 1)", "one number stands for all"),
        ],
    },
    Case {
        name: "prior_that_varies",
        prelude: "",
        script: "param h = 2\nparam i ~ normal(h, 1)\nloss fit = i ^ 2 + h ^ 2\noptimize fit",
        wanted: &[("dscene::flow::prior", "normal(h, 1)", "`prior(i, normal(h, sd))`")],
    },
    Case {
        name: "param_spaces",
        prelude: "",
        script: "param a = 0 in 0..1 { space: interior }\nparam b = 3 { space: interior }\nparam c = 0 { space: positive }\n\
                 param d = [0, 2, 0] { space: unit }\nparam e = [1, 2] { space: unit }\nparam f = 2 { space: log }\n\
                 param g: rotation = euler(y: 20deg) { space: unit }\n\
                 param h = [[0, 1, 0]] { space: positive, precondition: laplacian(icosphere()) }\n\
                 param i = [0, 1, 0] in -1..1 { space: unit }\nparam j = 3 in 4..\nparam k = 3 in ..2\nparam l = 3 in 5\n\
                 param m ~ uniform(0, 1) { space: interior }",
        wanted: &[
            ("dscene::type::bounds", "0", "start between"),
            ("dscene::type::space", "interior", "`param b = 3 in 0..1 { space: interior }`"),
            ("dscene::type::space", "0", "start above 0"),
            ("dscene::type::space", "[0, 2, 0]", "`normalize([0, 2, 0])`"),
            ("dscene::type::space", "[1, 2]", "param d = [0, 1, 0] { space: unit }"),
            ("dscene::name::unknown", "log", "`positive`"),
            ("dscene::type::space", "unit", "leave `space` out"),
            ("dscene::type::space", "precondition", "leave one"),
            ("dscene::type::space", "-1..1", "leave them out"),
            ("dscene::type::bounds", "3", "start inside"),
            ("dscene::type::bounds", "3", "start inside"),
            ("dscene::type::bounds", "5", "in 0.."),
        ],
    },
    Case {
        name: "preconditioners",
        prelude: "",
        script: "param a = 1 { precondition: laplacian(icosphere()) }\nparam b = [[1, 2], [3, 4]] { precondition: pyramid(levels: 0) }\n\
                 param c = [[1, 2, 3]] { precondition: laplacian(lambda: 3) }\nparam d = [[1, 2], [3, 4]] { precondition: 3 }\n\
                 param e: rotation = euler(y: 20deg) { precondition: laplacian(icosphere()) }\nlet f = laplacian(icosphere(), lambda: 0)",
        wanted: &[
            ("dscene::type::param", "precondition", "leave it out"),
            ("dscene::value::range", "0", "1"),
            ("dscene::call::missing", "laplacian", "mesh: mesh"),
            ("dscene::type::mismatch", "3", ""),
            ("dscene::type::param", "precondition", "leave it out"),
            ("dscene::value::range", "0", "more than"),
        ],
    },
    Case {
        name: "not_available_yet",
        prelude: SCENE,
        script: "mesh coarse = decimate(sphere())\n\
                 optimize fit { correlated: true }\noptimize fit { correlated: false }",
        wanted: &[
            ("dscene::feature::unavailable", "decimate", ""),
            ("dscene::feature::unavailable", "correlated", "independent samples"),
        ],
    },
    Case {
        name: "function_values",
        prelude: "",
        script: "\
let double = x => x * 2
fn twice(f, x) = f(f(x))
let right: scalar = double(3) + twice(double, 1) + twice(y => y + double(y), 1)
let wrong = double(\"a\")
camera eye { fov: twice(double, 5) }
loss vector = double([1, 2])
let count = double(1, 2)",
        wanted: &[
            ("dscene::type::mismatch", "*", ""),
            ("dscene::type::unit", "twice(double, 5)", "* 1deg"),
            ("dscene::type::loss", "double([1, 2])", "mean"),
            ("dscene::call::count", "double(1, 2)", ""),
        ],
    },
    Case {
        name: "vectors_and_fields",
        prelude: SCENE,
        script: "camera side { film: 256, fov: 45deg }\nlet a = dot([1, 2, 3], [1, 2])\nlet f = (x, x) => x\n\
                 print grad(fit, ball), grad(fit, ball.mesh)\nlet b = 1\nsize = 3",
        wanted: &[
            ("dscene::type::mismatch", "256", "`[256, 256]`"),
            ("dscene::type::shape", "[1, 2]", ""),
            ("dscene::name::duplicate", "x", ""),
            ("dscene::type::param", "ball", "`ball.mesh.vertices`"),
            ("dscene::type::param", "ball.mesh", "`ball.mesh.vertices`"),
            ("dscene::syntax::unexpected", "=", "`let size2 = 3`"),
        ],
    },
    Case {
        name: "statements_without_names",
        prelude: SCENE,
        script: "camera { fov: 45deg }\nparam = 3\nloss mse(render(eye), target)\nlet z = 1\nfor i in 0..3 { print i }\nlet x\nlet y {\nfov: 3 }",
        wanted: &[
            ("dscene::syntax::unexpected", "camera", "camera NAME { fov: 45deg }"),
            ("dscene::syntax::unexpected", "param", "param NAME = 3"),
            ("dscene::syntax::unexpected", "loss", "loss NAME = mse"),
            ("dscene::syntax::unknown_statement", "for", "`print [i for i in 0..3]`"),
            ("dscene::syntax::unexpected", "x", "let x = …"),
            ("dscene::syntax::unexpected", "{", "`let` has `=`"),
        ],
    },
    Case {
        name: "other_languages",
        prelude: SCENE,
        script: "\
let moved = ball.mesh.translate([0, 1, 0])
let bright = np.mean(target)
save target to out.png
light sun { direction: [0, -1, 0] }
environment sky { }
let f = x -> x + 1
let w = moved.vertices[0].w
save target \"a.png\"",
        wanted: &[
            ("dscene::name::field", "translate", "`ball.mesh |> translate([0, 1, 0])`"),
            ("dscene::name::unknown", "np", "`mean(target)`"),
            ("dscene::type::mismatch", "out.png", "`\"out.png\"`"),
            ("dscene::name::field", "direction", "`light sun = directional(direction: [0, -1, 0])`"),
            ("dscene::syntax::unknown_statement", "environment", "`light sky { }`"),
            ("dscene::syntax::unexpected", "->", "`x => x + 1`"),
            ("dscene::syntax::unexpected", "\"", "`save target to \"a.png\"`"),
        ],
    },
    Case {
        name: "sweeps",
        prelude: SCENE,
        script: "\
sweep rat in [0.01, 0.1], spp in 3..3, size in [1, \"big\"], seed in [1.5], rat in [2] {
  optimize fit { using: adam(lr: 0.01), spp: spp }
  report { fit, far: [size, 2], is_far: size > 2, fit: 2, when: second }
  let late = 3
  sweep i in 0..2 { print i }
  report { size }
}
print fit
sweep again in [1] { print again }",
        wanted: &[
            ("dscene::sweep::empty", "3..3", "`0..5`"),
            ("dscene::type::mismatch", "\"big\"", ""),
            ("dscene::sweep::seed", "1.5", "`seed in 0..5`"),
            ("dscene::call::duplicate", "rat", ""),
            ("dscene::type::mismatch", "[size, 2]", "norm([size, 2])"),
            ("dscene::type::mismatch", "size > 2", "`if size > 2 then 1 else 0`"),
            ("dscene::call::duplicate", "fit", ""),
            ("dscene::name::unknown", "second", ""),
            ("dscene::sweep::declaration", "let late = 3", "move it out"),
            ("dscene::sweep::nested", "sweep i in 0..2", "its variables too"),
            ("dscene::sweep::report", "report { size }", "one of them"),
            ("dscene::sweep::beside", "print fit", "into the braces"),
            ("dscene::sweep::twice", "sweep again in [1]", "both at once"),
        ],
    },
    Case {
        name: "sweeps_of_nothing",
        prelude: SCENE,
        script: "\
fn twice(x) = 2 * x
sweep sise in [1, 2], rate in 0.1, twice in [1], twin in [twin] {
  optimize fit { using: adam(lr: rate) }
}",
        wanted: &[
            ("dscene::type::mismatch", "0.1", "`[0.1]`"),
            ("dscene::type::mismatch", "twice", ""),
            ("dscene::name::cycle", "twin", ""),
        ],
    },
    Case {
        name: "sweep_without_effect",
        prelude: SCENE,
        script: "sweep sise in [1, 2] { optimize fit { steps: 3 } }",
        wanted: &[("dscene::sweep::unused", "sise", "did you mean `size`?")],
    },
    Case {
        name: "plots",
        prelude: SCENE,
        script: "\
let rates = [0.1, 0.01, 0.001]
plot [1, 2] over rates to \"a.svg\"
plot fit, size to \"a.pdf\" { log: \"z\", legend: [\"one\"] }
plot rates { yscale: \"log\", tilte: \"Rates\", band: [1, 2], size: [10, 10] }
plot fit over rates
plot [[[1]]], [], sphere()
plot rates, rates { band: 0.1 }",
        wanted: &[
            ("dscene::type::shape", "rates", ""),
            ("dscene::file::format", "\"a.pdf\"", "`.png`"),
            ("dscene::type::mismatch", "\"z\"", ""),
            ("dscene::type::shape", "[\"one\"]", ""),
            ("dscene::name::field", "yscale", "`log: y`"),
            ("dscene::name::field", "tilte", "did you mean `title`?"),
            ("dscene::type::shape", "[1, 2]", "of several curves a list"),
            ("dscene::value::range", "[10, 10]", ""),
            ("dscene::type::shape", "rates", ""),
            ("dscene::type::mismatch", "[[[1]]]", "plot numbers"),
            ("dscene::type::shape", "[]", ""),
            ("dscene::type::mismatch", "sphere()", "plot numbers"),
            ("dscene::type::shape", "0.1", "of several curves a list"),
        ],
    },
    Case {
        name: "report_without_sweep",
        prelude: SCENE,
        script: "optimize fit { steps: 10 }\nreport { error: fit, seconds }",
        wanted: &[("dscene::sweep::report", "report { error: fit, seconds }", "`sweep NAME in [a, b] { … }`")],
    },
    Case {
        name: "many_at_once",
        prelude: "",
        script: "\
camera eye { fov: 45, film: [64, 64.5] }
let a = undefined + 1
let b = a + also_undefined
let c = b * 2
shape s { mesh: spere(), material: diffuse(reflectance: \"red.png\") }
expect 3",
        wanted: &[
            ("dscene::type::unit", "45", "45deg"),
            ("dscene::type::mismatch", "[64, 64.5]", ""),
            ("dscene::name::unknown", "undefined", ""),
            ("dscene::name::unknown", "also_undefined", ""),
            ("dscene::name::unknown", "spere", "did you mean `sphere`?"),
            ("dscene::type::mismatch", "\"red.png\"", "texture(\"red.png\")"),
            ("dscene::type::mismatch", "3", "3 > 0"),
        ],
    },
];

#[test]
fn wrong_scripts_are_told_what_is_wrong_where_and_what_to_write() {
    let mut failures = Vec::new();
    for case in cases() {
        let text = format!("{}{}\n", case.prelude, case.script);
        let checked = check_text(&format!("{}.dscene", case.name), None, text, &[], &Disk);
        let found: Vec<(&str, &str, String)> = checked
            .diagnostics
            .iter()
            .map(|d| (d.code, d.span().map_or("", |s| checked.sources.text(s)), d.helps.join("\n")))
            .collect();
        let same = found.len() == case.wanted.len()
            && found.iter().zip(case.wanted).all(|(f, w)| f.0 == w.0 && f.1 == w.1 && f.2.contains(w.2));
        let rendered = render_all(&checked.diagnostics, &checked.sources, RenderOptions::plain());
        if !same {
            failures.push(format!("{}: wanted {:#?}\nfound {found:#?}\n{rendered}", case.name, case.wanted));
        }
        if let Err(difference) = expect_file(case.name, &rendered) {
            failures.push(difference);
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n\n"));
}

#[test]
fn no_label_points_into_the_library() {
    for case in cases() {
        let text = format!("{}{}\n", case.prelude, case.script);
        let checked = check_text("script.dscene", None, text, &[], &Disk);
        for diagnostic in &checked.diagnostics {
            for label in &diagnostic.labels {
                assert_eq!(checked.sources.name(label.span.source), "script.dscene", "{}: {diagnostic:?}", case.name);
            }
        }
    }
}

/// Compares with the stored text, or stores it.
fn expect_file(name: &str, found: &str) -> Result<(), String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scripts/diagnostics").join(format!("{name}.txt"));
    if std::env::var_os("UPDATE_EXPECT").is_some() {
        return std::fs::write(&path, found).map_err(|e| e.to_string());
    }
    let wanted = std::fs::read_to_string(&path).unwrap_or_default();
    if wanted == found {
        return Ok(());
    }
    Err(format!("{name}: the picture differs; it is now\n{found}and was\n{wanted}"))
}
