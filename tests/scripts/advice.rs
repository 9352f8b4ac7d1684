//! Habits from other languages and systems: each wrong script gives one error, at the smallest place that proves it, with a text to
//! type; and what is typed then checks.

use dscene::check::{Disk, check_text};
use dscene::diag::Diagnostic;
use dscene::ide::Analysis;
use dscene::ide::fixes::fixes;

use crate::other_languages;

/// What the scripts may use.
const SCENE: &str = "\
camera eye { position: [0, 1, -4], look_at: [0, 0, 0], fov: 45deg, film: [64, 64] }
param size = 1
param n = 3 { frozen: true }
shape ball { mesh: sphere(radius: size), material: diffuse(reflectance: 0.5) }
light lamp = area(rectangle() |> flip() |> translate([0, 3, 0]), radiance: 10)
let c = true
let d = false
let v = [3, 4, 0]
let small = image([[1, 2], [3, 4]])
loss fit = mean(render(eye)) + n
";

/// The wrong script, the text under the first label, the text to type (`…` and `NAME` stand for anything), the mended script.
pub type Row = (&'static str, &'static str, &'static str, &'static str);

const ROWS: &[Row] = &[
    // Units.
    ("camera k { fov: pi / 4 }", "pi / 4", "(pi / 4) * 1rad", "camera k { fov: (pi / 4) * 1rad }"),
    ("camera k { fov: size * 30 }", "size * 30", "size * 30 * 1deg", "camera k { fov: size * 30 * 1deg }"),
    ("camera k { fov: 45 }", "45", "45deg", "camera k { fov: 45deg }"),
    ("let a = cube() |> rotate(y: -size)", "-size", "(-size) * 1deg", "let a = cube() |> rotate(y: (-size) * 1deg)"),
    ("let a = 40deg + 10%", "+", "40deg + 10% of 40deg", "let a = 40deg + 10% of 40deg"),
    ("let a = sin(10%)", "10%", "10% of 1deg", "let a = sin(10% of 1deg)"),
    ("let a = 45 deg", "deg", "45deg", "let a = 45deg"),
    ("let a = sin(30 degrees)", "degrees", "30deg", "let a = sin(30deg)"),
    ("let a = 1.5 rad", "rad", "1.5rad", "let a = 1.5rad"),
    ("let a = 45°", "°", "45deg", "let a = 45deg"),
    ("let a = 45degrees", "45degrees", "45deg", "let a = 45deg"),
    ("let a = sin(radians(45))", "radians", "45 * 1deg", "let a = sin(45 * 1deg)"),
    ("let a = degrees(atan2(1, 2))", "degrees", "atan2(1, 2) / 1deg", "let a = atan2(1, 2) / 1deg"),
    (
        "param b = 1 in 0..2 ~ normal(1, 1)",
        "~",
        "param b = 1 ~ normal(1, 1) in 0..2",
        "param b = 1 ~ normal(1, 1) in 0..2",
    ),
    ("param b = 45deg in 0..90", "0..90", "0deg..90deg", "param b = 45deg in 0deg..90deg"),
    ("let k = [0, 45deg, 0]", "0, 45deg, 0", "0deg, 45deg, 0deg", "let k = [0deg, 45deg, 0deg]"),
    // Arguments in another order, side by side, without their name, or of another function.
    (
        "material m = blend(0.5, diffuse(), conductor())",
        "0.5, diffuse(), conductor()",
        "diffuse(), conductor(), 0.5",
        "material m = blend(diffuse(), conductor(), 0.5)",
    ),
    (
        "material m = mix(diffuse(), conductor(), 0.3)",
        "diffuse()",
        "blend(diffuse(), conductor(), weight: 0.3)",
        "material m = blend(diffuse(), conductor(), weight: 0.3)",
    ),
    (
        "material m = mix(diffuse(), conductor())",
        "diffuse()",
        "blend(diffuse(), conductor(), weight: 0.5)",
        "material m = blend(diffuse(), conductor(), weight: 0.5)",
    ),
    ("let a = translate(cube(), 0, 1, 0)", "0, 1, 0", "[0, 1, 0]", "let a = translate(cube(), [0, 1, 0])"),
    ("let a = translate(0, 1, 0)", "0", "translation([0, 1, 0])", "let a = translation([0, 1, 0])"),
    ("let a = translate(v)", "v", "translation(v)", "let a = translation(v)"),
    ("let a = scale(2)", "2", "scaling(2)", "let a = scaling(2)"),
    ("let a = scale(1, 2, 3)", "1", "scaling([1, 2, 3])", "let a = scaling([1, 2, 3])"),
    ("let a = scale(v)", "v", "scaling(v)", "let a = scaling(v)"),
    ("let a = rotate(v, 30deg)", "v", "rotation(v, 30deg)", "let a = rotation(v, 30deg)"),
    (
        "let a = rotate(quaternion(1, 0, 0, 0))",
        "quaternion(1, 0, 0, 0)",
        "quaternion(1, 0, 0, 0) @ NAME",
        "let a = quaternion(1, 0, 0, 0) @ cube()",
    ),
    (
        "let a = rotate(cube(), quaternion(1, 0, 0, 0))",
        "quaternion(1, 0, 0, 0)",
        "by: quaternion(1, 0, 0, 0)",
        "let a = rotate(cube(), by: quaternion(1, 0, 0, 0))",
    ),
    ("let a = render(eye, 16)", "16", "spp: 16", "let a = render(eye, spp: 16)"),
    ("let a = render(eye, spp: \"4\")", "\"4\"", "4", "let a = render(eye, spp: 4)"),
    (
        "optimize fit { using: adam(lr: step => 0.1 / (step + 1)), steps: 3 }",
        "step => 0.1 / (step + 1)",
        "0.1 / (step + 1)",
        "optimize fit { using: adam(lr: 0.1 / (step + 1)), steps: 3 }",
    ),
    (
        "camera k { position: [0, 4, 0], look_at: [0, 0, 0], up: [0, 1, 0] }",
        "[0, 1, 0]",
        "up: [0, 0, 1]",
        "camera k { position: [0, 4, 0], look_at: [0, 0, 0], up: [0, 0, 1] }",
    ),
    ("camera k { fov: 40deg, film: 64, 64 }", "64, 64", "[64, 64]", "camera k { fov: 40deg, film: [64, 64] }"),
    // Names of other libraries for what is here.
    ("material m = dielectric(eta: 1.5)", "eta", "ior", "material m = dielectric(ior: 1.5)"),
    ("let a = mean([[1, 2]], dim: 0)", "dim", "axis", "let a = mean([[1, 2]], axis: 0)"),
    ("let a = mse(v, v, mask: v)", "mask", "weight", "let a = mse(v, v, weight: v)"),
    ("light l = ambient(1)", "ambient", "constant", "light l = constant(1)"),
    ("light l = emissive(3)", "emissive", "area(NAME, radiance: 3)", "light l = area(cube(), radiance: 3)"),
    ("let a = load_csv", "load_csv", "load_table", "let a = load_table"),
    (
        "material m = principled(roughness: 0.4, clearcoat_roughness: 0.1)",
        "clearcoat_roughness",
        "coated(principled(roughness: 0.4), coat_roughness: 0.1)",
        "material m = coated(principled(roughness: 0.4), coat_roughness: 0.1)",
    ),
    (
        "material m = conductor(roughness: 0.4, sheen_color: [1, 0, 0])",
        "sheen_color",
        "sheened(conductor(roughness: 0.4), sheen: [1, 0, 0])",
        "material m = sheened(conductor(roughness: 0.4), sheen: [1, 0, 0])",
    ),
    (
        "shape glass { mesh: cube(), material: glass() }",
        "glass",
        "dielectric(ior: 1.5)",
        "shape glass { mesh: cube(), material: dielectric(ior: 1.5) }",
    ),
    (
        "let b = lamp with { power: 3 }",
        "power",
        "lamp with { lamp.radiance: 3 }",
        "let b = lamp with { lamp.radiance: 3 }",
    ),
    (
        "shape f = studio.floor()",
        "studio",
        "import std.studio as studio",
        "import std.studio as studio\nshape f = studio.floor()",
    ),
    // A picture that is not declared is no module.
    ("let a = photo.width", "photo", "let photo = …", "let photo = render(eye)\nlet a = photo.width"),
    ("import studio", "studio", "std.studio", "import std.studio"),
    // What is no value, and names that are none.
    ("material m = diffuse(reflectance: None)", "None", "", "material m = diffuse()"),
    ("material m = diffuse(reflectance: none)", "none", "", "material m = diffuse()"),
    ("let 3d = 3", "3d", "d3", "let d3 = 3"),
    ("let a = 3 in v", "in", "len([x for x in v if x == 3]) > 0", "let a = len([x for x in v if x == 3]) > 0"),
    ("let a = 1 in 0..3", "in", "param a = 1 in 0..3", "param a = 1 in 0..3"),
    ("let a = vec3(1.0)", "vec3", "[1.0, 1.0, 1.0]", "let a = [1.0, 1.0, 1.0]"),
    ("let a = map(v, x => 2 * x)", "map", "[2 * x for x in v]", "let a = [2 * x for x in v]"),
    ("let a = int(\"3\")", "int", "3", "let a = 3"),
    // Lights by profiles.
    (
        "light l = spot(position: v, direction: [0, -1, 0], ies: image([[1]]))",
        "ies",
        "profile",
        "light l = spot(position: v, direction: [0, -1, 0], profile: image([[1]]))",
    ),
    (
        "light l = point(position: v, direction: [0, -1, 0], profile: image([[1]]))",
        "direction",
        "rotation: aim(…)",
        "light l = point(position: v, rotation: aim([0, -1, 0]), profile: image([[1]]))",
    ),
    (
        "light l = point(position: v, profile: image([[1]]), rotation: [0, -1, 0])",
        "[0, -1, 0]",
        "aim([0, -1, 0])",
        "light l = point(position: v, profile: image([[1]]), rotation: aim([0, -1, 0]))",
    ),
    (
        "light l = point(position: v, ies: image([[1]]))",
        "ies",
        "profile",
        "light l = point(position: v, profile: image([[1]]))",
    ),
    // Assignments.
    ("x = 3\nlet y = x + x", "=", "let x = 3", "let x = 3\nlet y = x + x"),
    ("let a = 1\nx = 3\nprint x, a", "=", "let x = 3", "let a = 1\nlet x = 3\nprint x, a"),
    ("let x = 1\nx += 2", "+=", "let x2 = x + 2", "let x = 1\nlet x2 = x + 2"),
    ("let x = 1\nx -= 2", "-=", "let x2 = x - 2", "let x = 1\nlet x2 = x - 2"),
    ("let x = 1\nx *= 2", "*=", "let x2 = x * 2", "let x = 1\nlet x2 = x * 2"),
    ("let x = 1\nx++", "++", "let x2 = x + 1", "let x = 1\nlet x2 = x + 1"),
    ("let x = 1\nx--", "--", "let x2 = x - 1", "let x = 1\nlet x2 = x - 1"),
    ("let x = 1\nx = x + 1", "=", "let x2 = x + 1", "let x = 1\nlet x2 = x + 1"),
    ("let x := 1", ":=", "let x = 1", "let x = 1"),
    ("x := 1", ":=", "let x = 1", "let x = 1"),
    ("eye.fov = 30deg", "=", "let changed = eye with { eye.fov: 30deg }", "let changed = eye with { eye.fov: 30deg }"),
    ("let x = 1;", ";", "", "let x = 1"),
    ("var x = 1", "var", "let x = 1", "let x = 1"),
    ("const x = 1;", "const", "let x = 1", "let x = 1"),
    ("float x = 1.0;", "float", "let x = 1.0", "let x = 1.0"),
    ("vec3 p = [1, 2, 3]", "vec3", "let p = [1, 2, 3]", "let p = [1, 2, 3]"),
    // Operators.
    ("expect 1 = 1", "=", "1 == 1", "expect 1 == 1"),
    ("let a = if v.x = 3 then 1 else 2", "=", "v.x == 3", "let a = if v.x == 3 then 1 else 2"),
    ("let a = 2 ** 3", "**", "2 ^ 3", "let a = 2 ^ 3"),
    ("let a = 2 <> 3", "<>", "2 != 3", "let a = 2 != 3"),
    ("expect size =~ 1", "=~", "size ≈ 1 within 1%", "expect size ≈ 1 within 1%"),
    ("expect size ~~ 1", "~~", "size ≈ 1 within 1%", "expect size ≈ 1 within 1%"),
    ("expect isclose(size, 1)", "isclose", "size ≈ 1 within 1%", "expect size ≈ 1 within 1%"),
    ("expect allclose(v, [3, 4, 0], 0.1)", "allclose", "v ≈ [3, 4, 0] within 1%", "expect v ≈ [3, 4, 0] within 1%"),
    ("let a = 2 === 3", "===", "2 == 3", "let a = 2 == 3"),
    ("let a = 2 !== 3", "!==", "2 != 3", "let a = 2 != 3"),
    ("let a = 2 =< 3", "=<", "2 <= 3", "let a = 2 <= 3"),
    ("let a = c && d", "&&", "c and d", "let a = c and d"),
    ("let a = c || d", "||", "c or d", "let a = c or d"),
    ("let a = !c", "!", "not c", "let a = not c"),
    ("let a = v ++ [5]", "++", "concat(v, [5])", "let a = concat(v, [5])"),
    ("let a = c ? 1 : 2", "?", "if c then 1 else 2", "let a = if c then 1 else 2"),
    ("let a = n is 3", "is", "n == 3", "let a = n == 3"),
    ("let a = n is not 3", "is", "n != 3", "let a = n != 3"),
    ("let a = 7 % 2", "%", "mod(7, 2)", "let a = mod(7, 2)"),
    ("let f = x -> x", "->", "x => x", "let f = x => x"),
    ("let f = lambda x: x + 1", "lambda", "x => x + 1", "let f = x => x + 1"),
    ("let f = |x| x + 1", "|x|", "x => x + 1", "let f = x => x + 1"),
    ("let a = [i for i in 0...3]", "...", "0..3", "let a = [i for i in 0..3]"),
    ("let a = [i for i in 0..]", "..", "0..n", "let a = [i for i in 0..n]"),
    // Literals.
    ("let a = .5", ".5", "0.5", "let a = 0.5"),
    ("let a = 1. + 2", "1.", "1.0", "let a = 1.0 + 2"),
    ("let a = 1.0f", "1.0f", "1.0", "let a = 1.0"),
    ("let a = 'text'", "'text'", "\"text\"", "let a = \"text\""),
    ("let a = `n is ${n}`", "`n is ${n}`", "\"n is {n}\"", "let a = \"n is {n}\""),
    ("let a = f\"n is {n}\"", "f", "\"n is {n}\"", "let a = \"n is {n}\""),
    ("let a = {\"a\": 1, \"b\": 2}", "{", "{ a: 1, b: 2 }", "let a = { a: 1, b: 2 }"),
    ("save { size n: 1 } to \"a.json\"", "n", "size: n", "save { size: n } to \"a.json\""),
    ("let a = dict(b: 1)", "dict", "{ … }", "let a = { b: 1 }"),
    ("let a = { a 1, b: 2 }", "1", "a: 1", "let a = { a: 1, b: 2 }"),
    ("let a = [{ n: 1, b n }]", "n", "b: n", "let a = [{ n: 1, b: n }]"),
    ("let a = { a = 1 }", "=", "a: 1", "let a = { a: 1 }"),
    ("fn f(x) { a: x }", "{", "fn f(x) = { a: x }", "fn f(x) = { a: x }"),
    ("let a = {1, 2}", "{", "[1, 2]", "let a = [1, 2]"),
    ("let a = (1, 2, 3)", ",", "[1, 2, 3]", "let a = [1, 2, 3]"),
    ("let a = True", "True", "true", "let a = true"),
    ("let a = FALSE", "FALSE", "false", "let a = false"),
    ("let a = PI", "PI", "pi", "let a = pi"),
    ("# a comment\nlet a = 1 # another", "#", "// a comment", "// a comment\nlet a = 1 // another"),
    ("#!/usr/bin/env dsl\nlet a = #ff8800", "#", "// /usr/bin/env dsl", "// /usr/bin/env dsl\nlet a = #ff8800"),
    ("let a = 1,000", ",", "1_000", "let a = 1_000"),
    ("let a = 50 %", "%", "50%", "let a = 50%"),
    ("let a = \"n\" + n", "+", "\"n{n}\"", "let a = \"n{n}\""),
    ("let a = n + \" samples\"", "+", "\"{n} samples\"", "let a = \"{n} samples\""),
    ("let a = \"n\" + \"m\"", "+", "\"nm\"", "let a = \"nm\""),
    ("let a = not n", "n", "n == 0", "let a = n == 0"),
    ("let a = [1, 2] + v", "+", "x[a..b]", "let x = v let a = [1, 2] + x[0..2] // x[a..b]"),
    ("let a = sqrt 4", "4", "sqrt(4)", "let a = sqrt(4)"),
    ("let a = 1 + sqrt n", "n", "sqrt(n)", "let a = 1 + sqrt(n)"),
    // Choices, functions and loops.
    ("let a = if c { 1 } else { 2 }", "{", "if c then 1 else 2", "let a = if c then 1 else 2"),
    ("let a = if (c) { 1 } else { 2 }", "{", "if c then 1 else 2", "let a = if c then 1 else 2"),
    ("let a = if c: 1 else: 2", ":", "if c then 1 else 2", "let a = if c then 1 else 2"),
    ("let a = 1 if c else 2", "if", "if c then 1 else 2", "let a = if c then 1 else 2"),
    ("let a = if c then 1 elif d then 2 else 3", "elif", "else if", "let a = if c then 1 else if d then 2 else 3"),
    ("def f(x): return x + 1", "def", "fn f(x) = x + 1", "fn f(x) = x + 1"),
    ("function f(x) { return x + 1; }", "function", "fn f(x) = x + 1", "fn f(x) = x + 1"),
    ("fn f(x) -> scalar = x + 1", "->", "fn f(x): scalar = x + 1", "fn f(x): scalar = x + 1"),
    ("fn f(x) => x + 1", "=>", "fn f(x) = x + 1", "fn f(x) = x + 1"),
    ("let f(x) = x + 1", "let", "fn f(x) = x + 1", "fn f(x) = x + 1"),
    ("fn f(x) {\n  return x + 1\n}", "return", "x + 1", "fn f(x) {\n  x + 1\n}"),
    ("return n", "return", "print n", "print n"),
    ("for i in range(3): print(i)", "for", "print [i for i in 0..3]", "print [i for i in 0..3]"),
    ("while c: n", "while", "[… for i in 0..n]", "print [i for i in 0..n]"),
    // Calls and statements.
    ("print(\"a\", 1)", ",", "print \"a\", 1", "print \"a\", 1"),
    ("save(render(eye), \"a.png\")", ",", "save render(eye) to \"a.png\"", "save render(eye) to \"a.png\""),
    ("save render(eye) \"a.png\"", "\"", "save render(eye) to \"a.png\"", "save render(eye) to \"a.png\""),
    ("save n as \"a.json\"", "as", "to \"a.json\"", "save n to \"a.json\""),
    ("save \"a.json\"", "\"a.json\"", "save NAME to \"a.json\"", "save n to \"a.json\""),
    ("write n to \"a.json\"", "write", "save n to \"a.json\"", "save n to \"a.json\""),
    (
        "LookAt 0 0 -4  0 0 0  0 1 0",
        "LookAt",
        "camera NAME { position: [0, 0, -4], look_at: [0, 0, 0] }",
        "camera k { position: [0, 0, -4], look_at: [0, 0, 0] }",
    ),
    ("let a: Tensor = v", "Tensor", "scalar[]", "let a: scalar[] = v"),
    ("camera k { width: 64 }", "width", "film", "camera k { film: [64, 48] }"),
    ("let a = v.map(x => x * 2)", "map", "[x * 2 for x in v]", "let a = [x * 2 for x in v]"),
    ("let a = map(p => p + 1, v)", "map", "[p + 1 for p in v]", "let a = [p + 1 for p in v]"),
    ("let a = v.filter(k => k > 1)", "filter", "[k for k in v if k > 1]", "let a = [k for k in v if k > 1]"),
    ("render(eye)", "render", "print render(eye)", "print render(eye)"),
    ("let a = render(eye, spp = 4)", "=", "spp: 4", "let a = render(eye, spp: 4)"),
    ("camera k { fov = 45deg }", "=", "fov: 45deg", "camera k { fov: 45deg }"),
    ("fn f(p: list[int]) = p", "list[int]", "int[]", "fn f(p: int[]) = p"),
    ("param p: float = 1", "float", "scalar", "param p: scalar = 1"),
    ("let a = zeros(3)", "zeros", "[0 for i in 0..3]", "let a = [0 for i in 0..3]"),
    ("let a = ones(3)", "ones", "[1 for i in 0..3]", "let a = [1 for i in 0..3]"),
    ("let a = [i for i in range(3)]", "range", "0..3", "let a = [i for i in 0..3]"),
    ("let a = [i for i in range(1, 3)]", "range", "1..3", "let a = [i for i in 1..3]"),
    ("let a = rgb(1, 0, 0)", "rgb", "[1, 0, 0]", "let a = [1, 0, 0]"),
    ("let a = vec3(1, 2, n)", "vec3", "[1, 2, n]", "let a = [1, 2, n]"),
    ("let a = str(n)", "str", "\"{n}\"", "let a = \"{n}\""),
    ("let a = int(3.5)", "int", "floor(3.5)", "let a = floor(3.5)"),
    ("let a = saturate(n)", "saturate", "clamp(n, 0, 1)", "let a = clamp(n, 0, 1)"),
    ("let a = lerp(1, 2, 0.5)", "lerp", "mix", "let a = mix(1, 2, 0.5)"),
    ("let a = log10(n)", "log10", "log(n) / log(10)", "let a = log(n) / log(10)"),
    ("let a = rsqrt(n)", "rsqrt", "1 / sqrt(n)", "let a = 1 / sqrt(n)"),
    ("let a = map(sqrt, v)", "map", "[sqrt(x) for x in v]", "let a = [sqrt(x) for x in v]"),
    ("let a = np.mean(v)", "np", "mean(v)", "let a = mean(v)"),
    ("let a = np.array([1, 2])", "np", "[1, 2]", "let a = [1, 2]"),
    ("let a = Math.sqrt(n)", "Math", "sqrt(n)", "let a = sqrt(n)"),
    ("let a = torch.zeros(3)", "torch", "[0 for i in 0..3]", "let a = [0 for i in 0..3]"),
    ("let a = np.linalg.norm(v)", "np", "norm(v)", "let a = norm(v)"),
    ("import numpy as np\nlet a = 1", "import numpy as np", "", "let a = 1"),
    // Methods and fields.
    ("let a = fit.grad", "grad", "grad(fit)", "let a = grad(fit)"),
    ("let a = fit.backward()", "backward", "grad(fit)", "let a = grad(fit)"),
    ("let a = v.map(sqrt)", "map", "[sqrt(x) for x in v]", "let a = [sqrt(x) for x in v]"),
    ("let a = v.mean()", "mean", "mean(v)", "let a = mean(v)"),
    ("let a = v.append(5)", "append", "concat(v, [5])", "let a = concat(v, [5])"),
    ("let a = v.shape", "shape", "len(v)", "let a = len(v)"),
    ("let a = n.item()", "item", "n", "let a = n"),
    ("let a = n.detach()", "detach", "stop_gradient(n)", "let a = stop_gradient(n)"),
    (
        "let a = cube().translate([1, 0, 0])",
        "translate",
        "cube() |> translate([1, 0, 0])",
        "let a = cube() |> translate([1, 0, 0])",
    ),
    ("let a = depth(eye).g", "g", "r", "let a = depth(eye).r"),
    // Other renderers.
    ("sensor k { fov: 45deg }", "sensor", "camera k { fov: 45deg }", "camera k { fov: 45deg }"),
    ("emitter l = point(position: v)", "emitter", "light l = point(position: v)", "light l = point(position: v)"),
    ("bsdf m = diffuse()", "bsdf", "material m = diffuse()", "material m = diffuse()"),
    ("shape s { mesh: cube(), bsdf: diffuse() }", "bsdf", "material", "shape s { mesh: cube(), material: diffuse() }"),
    (
        "shape s { mesh: cube(), material: \"diffuse\" }",
        "\"diffuse\"",
        "diffuse()",
        "shape s { mesh: cube(), material: diffuse() }",
    ),
    ("shape s { mesh: \"sphere\" }", "\"sphere\"", "sphere()", "shape s { mesh: sphere() }"),
    ("let m = diffuse(albedo: 0.5)", "albedo", "reflectance", "let m = diffuse(reflectance: 0.5)"),
    ("let m = lambertian()", "lambertian", "diffuse", "let m = diffuse()"),
    ("let m = twosided(diffuse())", "twosided", "diffuse()", "let m = diffuse()"),
    (
        "light l { position: v, intensity: 3 }",
        "position",
        "light l = point(position: v, intensity: 3)",
        "light l = point(position: v, intensity: 3)",
    ),
    (
        "light l { type: \"point\", position: v, intensity: 3 }",
        "type",
        "light l = point(position: v, intensity: 3)",
        "light l = point(position: v, intensity: 3)",
    ),
    (
        "shape s { type: \"sphere\", radius: 2, center: v, bsdf: diffuse() }",
        "type",
        "shape s { mesh: sphere(radius: 2) |> translate(v), material: diffuse() }",
        "shape s { mesh: sphere(radius: 2) |> translate(v), material: diffuse() }",
    ),
    (
        "camera k(position: v, look_at: [0, 0, 0])",
        "(",
        "camera k { position: v, look_at: [0, 0, 0] }",
        "camera k { position: v, look_at: [0, 0, 0] }",
    ),
    ("light = point(position: v)", "light", "light NAME = point(position: v)", "light l = point(position: v)"),
    ("save(v, \"v.json\")", ",", "save v to \"v.json\"", "save v to \"v.json\""),
    ("let a = (size, 2)", ",", "[size, 2]", "let a = [size, 2]"),
    ("imshow(render(eye))", "imshow", "save (render(eye)) to \"image.png\"", "save (render(eye)) to \"image.png\""),
    (
        "expect v == [3, 4, 1] and render(eye) == 0",
        "==",
        "render(eye) ≈ 0 within 1%",
        "expect v == [3, 4, 1] and render(eye) ≈ 0 within 1%",
    ),
    ("let a = sin([30, 60])", "[30, 60]", "[30, 60] * 1deg", "let a = sin([30, 60] * 1deg)"),
    ("let a = ball[0]", "ball", "ball.mesh.vertices[0]", "let a = ball.mesh.vertices[0]"),
    ("camera k { fov: 45deg, lookat: [0, 0, 0] }", "lookat", "look_at", "camera k { fov: 45deg, look_at: [0, 0, 0] }"),
    // Optimisers.
    ("optimize fit { using: \"adam\" }", "\"adam\"", "adam()", "optimize fit { using: adam() }"),
    ("optimize fit { using: \"Adam\" }", "\"Adam\"", "adam()", "optimize fit { using: adam() }"),
    ("optimize fit { lr: 0.1 }", "lr", "using: adam(lr: 0.1)", "optimize fit { using: adam(lr: 0.1) }"),
    ("optimize fit { optimizer: adam() }", "optimizer", "using", "optimize fit { using: adam() }"),
    ("optimize fit { epochs: 3 }", "epochs", "steps", "optimize fit { steps: 3 }"),
    ("minimize fit { steps: 3 }", "minimize", "optimize fit { steps: 3 }", "optimize fit { steps: 3 }"),
    ("optimize fit { using: SGD(lr: 0.1) }", "SGD", "sgd", "optimize fit { using: sgd(lr: 0.1) }"),
    ("param w = 1 { lr: adam }", "adam", "2", "param w = 1 { lr: 2 }"),
    ("param w = 1 { lr: adam(lr: 0.1) }", "adam(lr: 0.1)", "2", "param w = 1 { lr: 2 }"),
    ("param w = 1 { freeze: true }", "freeze", "frozen", "param w = 1 { frozen: true }"),
    ("optimize fit { freeze: [n] }", "freeze", "over: […]", "optimize fit { over: [size] }"),
    (
        "optimize fit { stage pose { frozen: n } }",
        "frozen",
        "over: […]",
        "optimize fit { stage pose { over: [size] } }",
    ),
    // Losses.
    ("let a = iou(alpha(eye), alpha(eye))", "iou", "silhouette_iou", "let a = silhouette_iou(alpha(eye), alpha(eye))"),
    (
        "let a = dice(alpha(eye), alpha(eye))",
        "dice",
        "silhouette_iou",
        "let a = silhouette_iou(alpha(eye), alpha(eye))",
    ),
    ("let f = lpips", "lpips", "perceptual_error", "let f = perceptual_error"),
    ("let a = edge_energy(ball.mesh)", "edge_energy", "edge_length_energy", "let a = edge_length_energy(ball.mesh)"),
    ("let a = tv_loss(render(eye))", "tv_loss", "total_variation", "let a = total_variation(render(eye))"),
    // Units of arguments that go together, and whole numbers.
    ("let a = where(true, 1, 2deg)", "1", "1deg", "let a = where(true, 1deg, 2deg)"),
    ("let a = max(1deg, 2)", "2", "2deg", "let a = max(1deg, 2deg)"),
    ("let a = max(1deg, size)", "size", "size * 1deg", "let a = max(1deg, size * 1deg)"),
    ("let a = clamp(1deg, 0, 1)", "0, 1", "0deg, 1deg", "let a = clamp(1deg, 0deg, 1deg)"),
    ("let a = clamp(1, 0deg, 1deg)", "1", "1deg", "let a = clamp(1deg, 0deg, 1deg)"),
    ("camera k { fov: 3.14159 / 4 }", "3.14159 / 4", "(3.14159 / 4) * 1rad", "camera k { fov: (3.14159 / 4) * 1rad }"),
    ("let a = sum(v, axis: 0.5)", "0.5", "0", "let a = sum(v, axis: 0)"),
    (
        "fn ap(f: (scalar) => scalar) = f(1)\nlet a = ap(sin)",
        "sin",
        "x => sin(x * 1deg)",
        "fn ap(f: (scalar) => scalar) = f(1)\nlet a = ap(x => sin(x * 1deg))",
    ),
    (
        "let a = pyramid_loss(render(eye), render(eye), loss: x => 1)",
        "x => 1",
        "(x, a) => 1",
        "let a = pyramid_loss(render(eye), render(eye), loss: (x, a) => 1)",
    ),
    ("let a = total_variation([1, 2])", "[1, 2]", "image([[1, 2]])", "let a = total_variation(image([[1, 2]]))"),
    ("let a = total_variation(1)", "1", "image([[1]])", "let a = total_variation(image([[1]]))"),
    ("let a = cube(size: 2).area", "area", "surface_area(cube(size: 2))", "let a = surface_area(cube(size: 2))"),
    ("let a = render(scene: eye)", "eye", "camera: eye", "let a = render(camera: eye)"),
    ("let a = v(0)", "v", "v[0]", "let a = v[0]"),
    ("let a = 2(3)", "2", "2 * 3", "let a = 2 * 3"),
    ("let a = step(0.5, size)", "step", "where(size < 0.5, 0, 1)", "let a = where(size < 0.5, 0, 1)"),
    ("let a = 3 pi", "pi", "3 * pi", "let a = 3 * pi"),
    ("let a = 20 cm", "cm", "20", "let a = 20"),
    // Declarations of other shapes.
    ("let x: 3", ":", "let x = 3", "let x = 3"),
    ("param x: 3", ":", "param x = 3", "param x = 3"),
    ("let x: sin(3deg)", ":", "let x = sin(3deg)", "let x = sin(3deg)"),
    ("x: 3", ":", "let x = 3", "let x = 3"),
    ("eye.fov: 30deg", ":", "let changed = eye with { eye.fov: 30deg }", "let changed = eye with { eye.fov: 30deg }"),
    ("fn f(x) = { return x }", "return", "fn f(x) = x", "fn f(x) = x"),
    ("fn f x = x", "x", "fn f(x) = x", "fn f(x) = x"),
    ("fn f x y = x + y", "x y", "fn f(x, y) = x + y", "fn f(x, y) = x + y"),
    ("fn f = x => x + 1", "=", "fn f(x) = x + 1", "fn f(x) = x + 1"),
    ("fn f(p: List[float]) = p", "List[float]", "scalar[]", "fn f(p: scalar[]) = p"),
    ("let a, b = 1, 2", "a, b", "let a = 1 let b = 2", "let a = 1 let b = 2"),
    ("let (a, b) = (1, 2)\nprint a + b", "(a, b)", "let a = 1 let b = 2", "let a = 1 let b = 2\nprint a + b"),
    ("let [a, b] = v", "[a, b]", "let a = v[0] let b = v[1]", "let a = v[0] let b = v[1]"),
    (
        "let {fov, film} = eye",
        "{fov, film}",
        "let fov = eye.fov let film = eye.film",
        "let fov = eye.fov let film = eye.film",
    ),
    ("param a = 1 in 0,1", "0,1", "0..1", "param a = 1 in 0..1"),
    ("param a = 1 in (0, 1)", "(0, 1)", "0..1", "param a = 1 in 0..1"),
    ("param a = 1 in 0 to 1", "0 to 1", "0..1", "param a = 1 in 0..1"),
    ("param a = 1 { min: 0, max: 1 }", "min", "param a = 1 in 0..1", "param a = 1 in 0..1"),
    ("let a = [i for i in ..3]", "..", "0..3", "let a = [i for i in 0..3]"),
    // Signs.
    ("let a = size ≠ 2", "≠", "size != 2", "let a = size != 2"),
    ("let a = size ≥ 2", "≥", "size >= 2", "let a = size >= 2"),
    ("let a = size ≤ 2", "≤", "size <= 2", "let a = size <= 2"),
    ("let a = 2 × 3", "×", "2 * 3", "let a = 2 * 3"),
    ("let a = 2 · 3", "·", "2 * 3", "let a = 2 * 3"),
    ("let a = 2 ÷ 3", "÷", "2 / 3", "let a = 2 / 3"),
    ("let a = 2 − 3", "−", "2 - 3", "let a = 2 - 3"),
    ("let a = −3", "−", "-3", "let a = -3"),
    ("let a = √2", "√", "sqrt(2)", "let a = sqrt(2)"),
    ("let a = √(2 + n)", "√", "sqrt(2 + n)", "let a = sqrt(2 + n)"),
    ("let a = n²", "²", "n ^ 2", "let a = n ^ 2"),
    ("let a = (n + 1)³", "³", "(n + 1) ^ 3", "let a = (n + 1) ^ 3"),
    ("let a = π / 2", "π", "pi", "let a = pi / 2"),
    ("let a = ∞", "∞", "1e9", "let a = 1e9"),
    ("let a = ¬c", "¬", "not c", "let a = not c"),
    ("let a = c ∧ d", "∧", "c and d", "let a = c and d"),
    ("let a = c ∨ d", "∨", "c or d", "let a = c or d"),
    ("let f = x → x", "→", "x => x", "let f = x => x"),
    ("let a = [x for x ∈ v]", "∈", "x in v", "let a = [x for x in v]"),
    ("let a = “text”", "“text”", "\"text\"", "let a = \"text\""),
    ("let a = ‘text’", "‘text’", "\"text\"", "let a = \"text\""),
    ("let a = \"\"\"text\"\"\"", "\"\"\"text\"\"\"", "\"text\"", "let a = \"text\""),
    ("let a = \"a {} b\"", "{}", "{…}", "let a = \"a {n} b\""),
    ("let a = \"a %d\" % n", "%", "\"… {n}\"", "let a = \"a {n}\""),
    ("let a = 1 << 2", "<<", "1 * 2 ^ 2", "let a = 1 * 2 ^ 2"),
    ("let a = 8 >> 2", ">>", "floor(8 / 2 ^ 2)", "let a = floor(8 / 2 ^ 2)"),
    ("let a = 7 mod 2", "mod", "mod(7, 2)", "let a = mod(7, 2)"),
    ("let a = 7 div 2", "div", "floor(7 / 2)", "let a = floor(7 / 2)"),
    ("let a = c xor d", "xor", "c != d", "let a = c != d"),
    ("let a = c | d", "|", "c or d", "let a = c or d"),
    ("let a = c && !d", "&&", "c and not d", "let a = c and not d"),
    ("let x = 1\n++x", "++", "let x2 = x + 1", "let x = 1\nlet x2 = x + 1"),
    (
        "let a = c ? d ? 1 : 2 : 3",
        "?",
        "if c then if d then 1 else 2 else 3",
        "let a = if c then if d then 1 else 2 else 3",
    ),
    (
        "let a = c ? 1 : d ? 2 : 3",
        "?",
        "if c then 1 else if d then 2 else 3",
        "let a = if c then 1 else if d then 2 else 3",
    ),
    ("let a = |n|", "|n|", "abs(n)", "let a = abs(n)"),
    // Names and functions of other languages.
    ("let a = zeros([3])", "zeros", "[0 for i in 0..3]", "let a = [0 for i in 0..3]"),
    ("let a = ones([2, 2])", "ones", "[[1 for j in 0..2] for i in 0..2]", "let a = [[1 for j in 0..2] for i in 0..2]"),
    ("let a = ones(2, n)", "ones", "[[1 for j in 0..n] for i in 0..2]", "let a = [[1 for j in 0..n] for i in 0..2]"),
    (
        "let a = full([2, 3], 0.5)",
        "full",
        "[[0.5 for j in 0..3] for i in 0..2]",
        "let a = [[0.5 for j in 0..3] for i in 0..2]",
    ),
    ("let a = repeat(n, 3)", "repeat", "[n for i in 0..3]", "let a = [n for i in 0..3]"),
    ("let a = tau", "tau", "2 * pi", "let a = 2 * pi"),
    ("let a = TWO_PI / 3", "TWO_PI", "2 * pi", "let a = 2 * pi / 3"),
    ("let a = HALF_PI", "HALF_PI", "pi / 2", "let a = pi / 2"),
    ("let a = e", "e", "exp(1)", "let a = exp(1)"),
    ("let a = inf", "inf", "1e9", "let a = 1e9"),
    ("let a = infinity", "infinity", "1e9", "let a = 1e9"),
    ("let a = nan", "nan", "is_nan(…)", "let a = is_nan(n)"),
    ("let a = inverse_sqrt(size)", "inverse_sqrt", "1 / sqrt(size)", "let a = 1 / sqrt(size)"),
    ("let a = fract(size)", "fract", "size - floor(size)", "let a = size - floor(size)"),
    ("let a = hypot(3, size)", "hypot", "norm([3, size])", "let a = norm([3, size])"),
    ("let a = sinh(size)", "sinh", "(exp(size) - exp(-size)) / 2", "let a = (exp(size) - exp(-size)) / 2"),
    ("let a = cosh(size)", "cosh", "(exp(size) + exp(-size)) / 2", "let a = (exp(size) + exp(-size)) / 2"),
    ("let a = log1p(size)", "log1p", "log(1 + size)", "let a = log(1 + size)"),
    ("let a = expm1(size)", "expm1", "exp(size) - 1", "let a = exp(size) - 1"),
    ("let a = softplus(size)", "softplus", "log(1 + exp(size))", "let a = log(1 + exp(size))"),
    ("let a = logit(0.3)", "logit", "log(0.3 / (1 - 0.3))", "let a = log(0.3 / (1 - 0.3))"),
    ("let a = rand(3)", "rand", "uniform(3)", "let a = uniform(3)"),
    ("let a = random()", "random", "uniform(1)[0]", "let a = uniform(1)[0]"),
    ("let a = matmul(v, v)", "matmul", "v @ v", "let a = v @ v"),
    ("let a = power(2, size)", "power", "2 ^ size", "let a = 2 ^ size"),
    ("let a = multiply(v, size)", "multiply", "v * size", "let a = v * size"),
    ("let a = add(v, size)", "add", "v + size", "let a = v + size"),
    ("let a = subtract(v, size)", "subtract", "v - size", "let a = v - size"),
    ("let a = divide(v, size + 1)", "divide", "v / (size + 1)", "let a = v / (size + 1)"),
    ("let a = reduce((a, b) => a + b, v)", "reduce", "sum(…)", "let a = sum(v)"),
    ("let a = xor(c, d)", "xor", "c != d", "let a = c != d"),
    ("let a = logical_and(c, d)", "logical_and", "c and d", "let a = c and d"),
    ("let a = logical_or(c, d)", "logical_or", "c or d", "let a = c or d"),
    ("let a = logical_not(c)", "logical_not", "not c", "let a = not c"),
    (
        "let a = cumsum(v)",
        "cumsum",
        "[sum(v[0..i + 1]) for i in 0..len(v)]",
        "let a = [sum(v[0..i + 1]) for i in 0..len(v)]",
    ),
    ("let a = prod([1, 2])", "prod", "exp(sum(log([1, 2])))", "let a = exp(sum(log([1, 2])))"),
    ("let a = reversed(v)", "reversed", "[v[-1 - i] for i in 0..len(v)]", "let a = [v[-1 - i] for i in 0..len(v)]"),
    ("let a = outer(v, v)", "outer", "[[a * b for b in v] for a in v]", "let a = [[a * b for b in v] for a in v]"),
    (
        "let a = np.eye(3)",
        "np",
        "[[if i == j then 1 else 0 for j in 0..3] for i in 0..3]",
        "let a = [[if i == j then 1 else 0 for j in 0..3] for i in 0..3]",
    ),
    ("let a = any_of([c, d])", "any_of", "any", "let a = any([c, d])"),
    ("let a = all_of([c, d])", "all_of", "all", "let a = all([c, d])"),
    ("let a = maximum(size, 2)", "maximum", "max", "let a = max(size, 2)"),
    ("let a = fabs(size)", "fabs", "abs", "let a = abs(size)"),
    ("let a = sgn(size)", "sgn", "sign", "let a = sign(size)"),
    ("let a = sorted(v)", "sorted", "sort", "let a = sort(v)"),
    ("let a = normalise(v)", "normalise", "normalize", "let a = normalize(v)"),
    ("let a = magnitude(v)", "magnitude", "norm", "let a = norm(v)"),
    ("let max = 3\nlet a = v.max()", "max", "max(v)", "let max = 3\nlet a = max(v)"),
    // Statements in another shape.
    ("optimize fit, steps: 3", ", steps: 3", "optimize fit { steps: 3 }", "optimize fit { steps: 3 }"),
    ("optimize(fit, steps=3)", "(", "optimize fit { steps: 3 }", "optimize fit { steps: 3 }"),
    ("optimize fit for 3 steps", "for 3 steps", "optimize fit { steps: 3 }", "optimize fit { steps: 3 }"),
    (
        "optimize fit over size { steps: 3 }",
        "over size",
        "optimize fit { over: [size], steps: 3 }",
        "optimize fit { over: [size], steps: 3 }",
    ),
    ("plot v, title=\"a\"", "title=\"a\"", "plot v { title: \"a\" }", "plot v { title: \"a\" }"),
    ("expect size == 1: \"one\"", ":", "expect size == 1, \"one\"", "expect size == 1, \"one\""),
    ("import studio from \"std\"", "studio from \"std\"", "import std.studio as studio", "import std.studio as studio"),
    ("save render(eye) > \"a.png\"", ">", "save render(eye) to \"a.png\"", "save render(eye) to \"a.png\""),
    ("save(\"a.png\", render(eye))", ",", "save render(eye) to \"a.png\"", "save render(eye) to \"a.png\""),
    ("render(eye).save(\"a.png\")", "render", "save render(eye) to \"a.png\"", "save render(eye) to \"a.png\""),
    ("console.log(size)", "console", "print size", "print size"),
    (
        "sweep rate in 0.1, 0.01 { optimize fit { using: adam(lr: rate), steps: 3 } }",
        "0.1, 0.01",
        "[0.1, 0.01]",
        "sweep rate in [0.1, 0.01] { optimize fit { using: adam(lr: rate), steps: 3 } }",
    ),
    ("f(x) = x * 2", "f", "fn f(x) = x * 2", "fn f(x) = x * 2"),
    ("fn f(x) {\n  y = x * 2\n  y\n}", "=", "let y = x * 2", "fn f(x) {\n  let y = x * 2\n  y\n}"),
    ("param float x = 1.0", "float", "param x = 1.0", "param x = 1.0"),
    ("param x := 1", ":=", "param x = 1", "param x = 1"),
    ("param p, q = 1, 2", "p, q", "param p = 1 param q = 2", "param p = 1 param q = 2"),
    (
        "material m = diffuse { reflectance: 0.5 }",
        "{",
        "diffuse(reflectance: 0.5)",
        "material m = diffuse(reflectance: 0.5)",
    ),
    ("let a = size.value", "value", "size", "let a = size"),
    ("let a = eye.film.width", "width", "x", "let a = eye.film.x"),
    ("let g = gradient(fit, size)", "fit", "grad(fit, size)", "let g = grad(fit, size)"),
    // One cause, one error.
    ("let a = mix(a: 1, 2, 0.5)", "2", "b: 2", "let a = mix(a: 1, b: 2, t: 0.5)"),
    (
        "texture wood = \"wood.png\"\nmaterial m = diffuse(reflectance: wood)",
        "\"wood.png\"",
        "texture(\"wood.png\")",
        "texture wood = checkerboard() // texture(\"wood.png\")\nmaterial m = diffuse(reflectance: wood)",
    ),
];

/// These and those of further languages.
fn rows() -> impl Iterator<Item = &'static Row> {
    ROWS.iter().chain(other_languages::ROWS)
}

/// Scripts with one mistake, whatever uses what is wrong, and the text that is to blame.
const ONE_CAUSE: &[(&str, &str)] = &[
    ("let a = nowhere\nlet b = a + 1\nlet e = b.x + sin(b * 1deg)\nexpect e > b", "nowhere"),
    ("let a = (1 + 2\nlet b = a + 1\nprint b", "("),
    ("x = 3\nprint x\nprint x + 1\nlet y = x.z", "="),
    ("let x == 3\nprint x\nprint x + 1", "=="),
    ("camera k { fov: 45 }\nlet i = render(k)\nprint mean(i)", "45"),
    ("fn f(x) = x + nothing\nprint f(1), f(2), f([1, 2])", "nothing"),
    ("mesh m = 3\nshape s { mesh: m }\nlet w = m.vertices", "3"),
    ("material m = \"red\"\nshape s { mesh: cube(), material: m }", "\"red\""),
    ("light l { direction: v, irradiance: 3 }\nscene s = scene(shapes: [ball], lights: [l])", "direction"),
    ("let w = sphere(radios: 2)\nlet u = w |> translate([1, 0, 0])", "radios"),
    ("import \"nowhere.dscene\" as lib\nprint lib.x, lib.f(3)", "import \"nowhere.dscene\" as lib"),
    ("param p: colour = 1\nmaterial m = diffuse(reflectance: p)", "colour"),
    ("for i in range(3):\n    print(i)", "for"),
    (
        "sweep goal in [2, 3] { loss far = (size - goal) ^ 2  optimize far { steps: 5 } }",
        "loss far = (size - goal) ^ 2",
    ),
    ("let a = foo + 1\nlet b = foo + 2\nlet f = foo * 3", "foo"),
    ("let a = cuve()\nlet b = cuve()", "cuve"),
    ("fn f(x) = x + foo\nprint f(1), f(v)\nlet a = foo", "foo"),
    ("import \"nowhere.dscene\"\nprint foo(3), bar\nlet a = foo(4)", "import \"nowhere.dscene\""),
    ("import { foo, bar } from \"nowhere.dscene\"\nprint foo(3), bar", "{ foo, bar } from \"nowhere.dscene\""),
    ("let a, b = 1, 2\nprint a, b", "a, b"),
    ("let a = α + 1\nprint a", "α"),
    ("param p = \"x\"\nloss q = mean(render(eye)) * p\noptimize q { steps: 3 }", "\"x\""),
    ("loss q = render(eye)\noptimize q { steps: 3 }", "render(eye)"),
    ("let a = distance([1, 2], [1, 2, 3])", "[1, 2, 3]"),
    ("fn f(a: scalar[n], b: scalar[n]) = a + b\nlet a = f([1, 2], [1, 2, 3])", "[1, 2, 3]"),
    ("let a = mse(render(eye), render(eye), weight: \"a\")", "\"a\""),
    ("let a = ssim(small, render(eye))", "render(eye)"),
    ("let a = ms_ssim(small, render(eye))", "render(eye)"),
    ("let a = flip_error(small, render(eye))", "render(eye)"),
    ("let a = flip_map(small, render(eye))", "render(eye)"),
    ("let a = gradient_l1(small, render(eye))", "render(eye)"),
    ("let a = pyramid_loss(small, render(eye))", "render(eye)"),
    ("let a = silhouette_iou(small, render(eye))", "render(eye)"),
    ("let a = guided_variation(small, render(eye))", "render(eye)"),
    ("let a = ssim(small, small, weight: render(eye))", "ssim(small, small, weight: render(eye))"),
    ("test \"far\" { param far = 3  expect far > size }", "param"),
];

#[test]
fn one_cause_gives_one_error() {
    let mut failures = Vec::new();
    for (script, blamed) in ONE_CAUSE.iter().chain(other_languages::ONE_CAUSE) {
        let found = errors(script);
        if found.len() != 1 || found[0].1 != *blamed {
            let shown: Vec<String> = found.iter().map(|(d, at)| format!("    {} at `{at}`", d.message)).collect();
            failures.push(format!("{script:?} should blame `{blamed}` alone\n{}", shown.join("\n")));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// A name that nothing has shows the first places where it stands, in the order of the text, whatever was checked first.
#[test]
fn a_name_that_nothing_has_is_told_once() {
    let script = "let a = b + foo\nlet b = foo + 1\nfn f(x) = x + foo\nprint f(1), f(v), foo\nlet g = foo";
    let found = errors(script);
    let [(error, _)] = found.as_slice() else { panic!("{found:?}") };
    let text = format!("{SCENE}{script}\n");
    let lines: Vec<usize> =
        error.labels.iter().map(|l| text[SCENE.len()..l.span.start as usize].lines().count()).collect();
    let texts: Vec<&str> = error.labels.iter().map(|l| l.text.as_str()).collect();
    assert_eq!((lines, texts), (vec![1, 2, 3], vec!["not found", "nor here", "nor here, and in 2 more places"]));
    // Where other arguments ask for other texts to type, each is told.
    assert_eq!(errors("let a = zeros(3)\nlet b = zeros(4)").len(), 2);
}

/// `let depth = depth(eye)`: what is no function hides none, whatever it is computed from.
#[test]
fn values_hide_no_functions() {
    for value in ["3", "mean(v) / 2", "-mean(v)", "\"{mean(v)}\"", "mean(v) > 2", "[x for x in v]", "{ a: 1 }", "0..3"]
    {
        let found = errors(&format!("let mean = {value}\nlet a = mean(v) + 1\nprint mean, a"));
        assert!(found.is_empty(), "{value}: {found:?}");
    }
}

/// The errors of a script behind the scene.
fn errors(script: &str) -> Vec<(Diagnostic, String)> {
    let checked = check_text("script.dscene", None, format!("{SCENE}{script}\n"), &[], &Disk);
    let label = |d: &Diagnostic| d.span().map_or("", |s| checked.sources.text(s)).to_owned();
    checked.diagnostics.iter().filter(|d| d.is_error()).map(|d| (d.clone(), label(d))).collect()
}

/// Whether a text to type stands in a script, `…` and `NAME` for anything.
fn contains(script: &str, typed: &str) -> bool {
    let mut rest = script;
    typed.split('…').flat_map(|part| part.split("NAME")).all(|part| match rest.find(part) {
        Some(at) => {
            rest = &rest[at + part.len()..];
            true
        }
        None => false,
    })
}

#[test]
fn each_habit_gives_one_error_and_the_text_to_type() {
    let mut failures = Vec::new();
    for (wrong, blamed, typed, mended) in rows().filter(|row| !row.3.is_empty()) {
        let found = errors(wrong);
        let shown: Vec<String> =
            found.iter().map(|(d, at)| format!("    {} at `{at}`: {:?}", d.message, d.helps)).collect();
        let shown = shown.join("\n");
        match found.as_slice() {
            [(error, at)] => {
                if at != blamed {
                    failures.push(format!("{wrong:?} should blame `{blamed}`\n{shown}"));
                }
                let help = error.helps.join("\n");
                if !help.contains(&format!("`{typed}`")) && !typed.is_empty() || help.is_empty() {
                    failures.push(format!("{wrong:?} should say to type `{typed}`\n{shown}"));
                }
            }
            _ => failures.push(format!("{wrong:?} gives {} errors\n{shown}", found.len())),
        }
        if !contains(mended, typed) {
            failures.push(format!("{mended:?} is not what `{typed}` says"));
        }
        for (error, at) in errors(mended) {
            failures.push(format!("{mended:?} is still wrong: {} at `{at}`", error.message));
        }
    }
    assert!(failures.is_empty(), "{} failures\n{}", failures.len(), failures.join("\n"));
}

/// A script after quick fixes, the first one that is offered for its first error, until it has none or none is offered. Of a help that
/// lists what there is, that which gives `mended`.
fn fixed(wrong: &str, mended: &str) -> String {
    let mut script = wrong.to_owned();
    for _ in 0..3 {
        let text = format!("{SCENE}{script}\n");
        let analysis = Analysis::new("script.dscene", None, &text, &Disk, None);
        let error = analysis.known.diagnostics.iter().find(|d| d.is_error());
        let Some(error) = error else { break };
        let found: Vec<String> = fixes(&analysis, error, &Disk)
            .iter()
            .map(|fix| fix.applied(&text)[SCENE.len()..].trim_end().to_owned())
            .collect();
        let is_list = error.helps.iter().any(|help| help.contains("`, `"));
        let Some(next) = found.iter().find(|f| is_list && *f == mended).or(found.first()) else { break };
        script.clone_from(next);
    }
    script
}

#[test]
fn editors_type_what_a_help_says() {
    let mut failures = Vec::new();
    // A text with a gap is nothing to type; a file that is not there is still wrong, and so is a number where a size belongs.
    let is_typed = |typed: &str| !["…", "NAME", "a..b"].iter().any(|gap| typed.contains(gap));
    // `1,000` becomes `1000`, which is right too; an import stands before all that the script has.
    let is_last = |wrong: &str| {
        !["wood.png", "width: 64", "1,000", "studio.floor", "gold()"].iter().any(|more| wrong.contains(more))
    };
    let typed = rows().filter(|(wrong, _, typed, _)| is_typed(typed) && is_last(wrong));
    for (wrong, _, typed, mended) in typed.filter(|row| !row.3.is_empty()) {
        let found = fixed(wrong, mended);
        if found != *mended {
            failures.push(format!("{wrong:?} with `{typed}` should become\n    {mended:?}, became\n    {found:?}"));
        }
    }
    assert!(failures.is_empty(), "{} of {}\n{}", failures.len(), rows().count(), failures.join("\n"));
}
