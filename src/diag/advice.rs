//! What people write who come from Python, GLSL, JavaScript, Mitsuba, PBRT, Blender or PyTorch, and what is written here
//! instead. What the language knows of other languages stands here and, what things are called, in `names`; parser and checker ask with
//! what they found and where, and every row is a test (`tests/scripts/advice.rs`).

mod names;

pub use names::*;

use crate::diag::Diagnostic;
use crate::source::Span;

/// Where a foreign spelling was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Between two operands, or before one.
    Operator,
    /// After an operand, with nothing behind it: `i++`.
    Postfix,
    /// The first word of a statement.
    Statement,
    /// The last name of a call that is a statement of its own: `optimizer.step()`.
    Action,
    /// A name that is called.
    Call,
    /// A name that is not called.
    Name,
    /// A name that is called after a dot, or a field that nothing has.
    Method,
}

/// One way to write something elsewhere.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    pub place: Place,
    /// The spellings, separated by blanks.
    pub spellings: &'static str,
    /// The text to type, with what the user wrote in place of `$<` (the operand before, or the value before the dot), `$>` (the
    /// operand behind, or the rest of the statement), `$1` to `$3`, `$*` (the arguments) and `$v` (the arguments as a colour or a vector of three: one
    /// number three times).
    pub write: &'static str,
    /// Why, put before the text to type; may be empty.
    pub why: &'static str,
}

const fn row(place: Place, spellings: &'static str, write: &'static str, why: &'static str) -> Row {
    Row { place, spellings, write, why }
}

/// What stood around a foreign spelling.
#[derive(Clone, Debug, Default)]
pub struct Around<'a> {
    pub before: &'a str,
    pub behind: &'a str,
    pub arguments: Vec<&'a str>,
}

const KEEPS: &str = "a name keeps its value; give the new one a name of its own";
const NO_LOOPS: &str = "there are no loops: an array is built at once";

/// The table. A spelling may have several rows, for different numbers of arguments: the first that can be filled counts.
pub const TABLE: &[Row] = &[
    row(Place::Operator, "&& & AND And", "$< and $>", ""),
    row(Place::Operator, "|| OR Or", "$< or $>", ""),
    row(Place::Operator, ".*", "$< * $>", "all operators go element by element"),
    row(Place::Operator, "./", "$< / $>", "all operators go element by element"),
    row(Place::Operator, ".^", "$< ^ $>", "all operators go element by element"),
    row(Place::Operator, "?.", "$<.$>", "nothing is missing here"),
    row(Place::Operator, "<-", "let $< = $>", "values are declared"),
    row(Place::Operator, "! ~", "not $>", ""),
    row(Place::Operator, "**", "$< ^ $>", ""),
    row(Place::Operator, "<> !== =/= /= ≠ =!", "$< != $>", ""),
    row(Place::Operator, "^^ xor", "$< != $>", ""),
    row(Place::Operator, "∧", "$< and $>", ""),
    row(Place::Operator, "∨ |", "$< or $>", ""),
    row(Place::Operator, "¬", "not $>", ""),
    row(Place::Operator, "≤ ⩽", "$< <= $>", ""),
    row(Place::Operator, "≥ ⩾ >==", "$< >= $>", ""),
    row(Place::Operator, "× · ⋅", "$< * $>", ""),
    row(Place::Operator, "÷", "$< / $>", ""),
    row(Place::Operator, "− –", "$< - $>", ""),
    row(Place::Operator, "− –", "-$>", ""),
    row(Place::Operator, "√", "sqrt($>)", ""),
    row(Place::Operator, "∈", "$< in $>", ""),
    row(Place::Operator, "<<", "$< * 2 ^ $>", "numbers have no bits to shift"),
    row(Place::Operator, ">>", "floor($< / 2 ^ $>)", "numbers have no bits to shift"),
    row(Place::Operator, "div", "floor($< / $>)", ""),
    row(Place::Operator, "mod rem", "mod($<, $>)", "the remainder is a function"),
    row(Place::Operator, "===", "$< == $>", ""),
    row(Place::Operator, "=~ ~~", "$< ≈ $> within 1%", "say how near"),
    row(Place::Operator, "=<", "$< <= $>", ""),
    row(Place::Operator, "++", "concat($<, $>)", "arrays are joined by a function, numbers added by `+`"),
    row(Place::Operator, "+=", "let $<2 = $< + $>", KEEPS),
    row(Place::Operator, "-=", "let $<2 = $< - $>", KEEPS),
    row(Place::Operator, "*=", "let $<2 = $< * $>", KEEPS),
    row(Place::Operator, "**= ^=", "let $<2 = $< ^ $>", KEEPS),
    row(Place::Operator, "%", "mod($<, $>)", "`%` is per cent, as in `30%`; the remainder is a function"),
    row(Place::Operator, ":=", "let $< = $>", "values are declared"),
    row(Place::Operator, "-> → ⇒", "$< => $>", "a function value has a double arrow"),
    row(Place::Operator, "..< ... …", "$<..$>", "a range `a..b` ends before b, `a..=b` with it"),
    row(Place::Operator, "::", "$<.$>", ""),
    row(Place::Operator, "??", "$<", "nothing is missing here that could be replaced"),
    row(Place::Postfix, "++", "let $<2 = $< + 1", KEEPS),
    row(Place::Postfix, "--", "let $<2 = $< - 1", KEEPS),
    row(Place::Postfix, "²", "$< ^ 2", ""),
    row(Place::Postfix, "³", "$< ^ 3", ""),
    row(Place::Postfix, "!", "round(exp(sum([log(i) for i in 1..=$<])))", "there is no factorial"),
    row(Place::Postfix, "°", "$<deg", "angles have the units `deg`, `rad` and `turn`"),
    row(Place::Statement, "var const val auto set mut static final define", "let $>", ""),
    row(
        Place::Statement,
        "float double integer boolean number vec2 vec3 vec4 float3 color scalar int bool string",
        "let $>",
        "types stand behind the name and are seldom needed",
    ),
    row(Place::Statement, "parameter variable unknown", "param $>", ""),
    row(Place::Statement, "sensor", "camera $>", ""),
    row(Place::Statement, "bsdf brdf shader diffuse conductor phong principled", "material $>", ""),
    row(
        Place::Statement,
        "emitter lamp LightSource AreaLightSource environment area point directional constant",
        "light $>",
        "",
    ),
    row(Place::Statement, "object geometry sphere cube rectangle", "shape $>", ""),
    row(Place::Statement, "objective cost", "loss $>", ""),
    row(Place::Statement, "minimize minimise optimise fit train", "optimize $>", ""),
    row(Place::Statement, "assert check require", "expect $>", ""),
    row(Place::Statement, "echo log println puts", "print $>", ""),
    row(Place::Statement, "write store export dump", "save $>", ""),
    row(Place::Statement, "imshow imsave show display", "save $> to \"image.png\"", "pictures are files"),
    row(
        Place::Statement,
        "LookAt lookAt Perspective Film",
        "camera NAME { position: …, look_at: …, fov: … }",
        "a camera has fields",
    ),
    row(Place::Statement, "use include require using", "import $>", ""),
    row(Place::Statement, "for while loop repeat", "[… for i in 0..n]", NO_LOOPS),
    row(Place::Statement, "if unless switch match", "let NAME = if … then … else …", "`if` is part of an expression"),
    row(
        Place::Statement,
        "class interface enum trait namespace",
        "fn",
        "there are no types of one's own: a function makes things anew",
    ),
    row(Place::Statement, "struct record", "let NAME = { … }", "a record needs no declaration"),
    row(Place::Call, "dict Dict SimpleNamespace", "{ … }", "braces make a record"),
    row(Place::Statement, "return yield", "print $>", "a script has no result, it shows values"),
    row(Place::Statement, "with", "", "nothing is opened or switched off here; a changed copy is `NAME with { … }`"),
    row(Place::Statement, "begin do try", "", "nothing is begun here: declarations stand one below the other"),
    row(
        Place::Statement,
        "pass exit quit end done fi help clear clc close pub public private export static global del async",
        "",
        "leave it out",
    ),
    row(Place::Statement, "type typedef", "", "leave it out: there are no types of one's own"),
    row(Place::Statement, "module", "fn $>", "what is made anew each time is a function"),
    row(
        Place::Statement,
        "union difference intersection hull",
        "",
        "meshes are not cut; `merge(a, b)` puts two together",
    ),
    row(
        Place::Action,
        "step zero_grad minimize fit train",
        "optimize LOSS { steps: 100 }",
        "an optimisation takes its steps itself",
    ),
    row(
        Place::Action,
        "backward enable_grad requires_grad_ retain_grad",
        "",
        "leave it out: derivatives are taken where they are needed, and `print grad(LOSS, PARAM)` shows one",
    ),
    row(
        Place::Action,
        "set_variant manual_seed seed set_device set_default_tensor_type eval cuda init",
        "",
        "leave it out: nothing is set up here",
    ),
    row(Place::Action, "write_bitmap imsave imwrite", "save $2 to $1", "saving is a statement"),
    row(Place::Action, "save_image savez save_obj", "save $1 to $2", "saving is a statement"),
    row(Place::Action, "savefig", "plot NAME to $1", "saving is a part of a plot"),
    row(Place::Action, "show imshow", "save NAME to \"image.png\"", "pictures are files"),
    row(
        Place::Action,
        "figure subplots axis xlabel ylabel title legend",
        "plot NAME { title: \"…\" }",
        "a plot has fields",
    ),
    row(Place::Action, "disp display alert", "print $*", ""),
    row(Place::Action, "printf fprintf", "print \"… {NAME}\"", "a string may hold values"),
    row(Place::Action, "primitive_cube_add", "shape NAME { mesh: cube() }", "what there is is declared"),
    row(
        Place::Action,
        "primitive_uv_sphere_add primitive_ico_sphere_add",
        "shape NAME { mesh: sphere() }",
        "what there is is declared",
    ),
    row(Place::Action, "primitive_plane_add", "shape NAME { mesh: rectangle() }", "what there is is declared"),
    row(Place::Action, "primitive_cylinder_add", "shape NAME { mesh: cylinder() }", "what there is is declared"),
    row(Place::Action, "light_add", "light NAME = point(position: …)", "what there is is declared"),
    row(Place::Action, "camera_add", "camera NAME { position: … }", "what there is is declared"),
    row(Place::Action, "render", "save render(NAME) to \"image.png\"", "pictures are files"),
    row(Place::Action, "add attach link", "", "leave it out: all shapes and lights of a script are in its scene"),
    row(
        Place::Action,
        "append push push_back extend",
        "let $<2 = concat($<, [$1])",
        "arrays keep their values; a longer one has a name of its own",
    ),
    row(Place::Call, "repeat", "[$1 for i in 0..$2]", ""),
    row(Place::Call, "zeros_like", "0 * $1", ""),
    row(Place::Call, "ones_like", "0 * $1 + 1", ""),
    row(Place::Call, "range arange iota", "$1..$2", ""),
    row(Place::Call, "range arange iota", "0..$1", ""),
    row(Place::Call, "rad", "$1 * 1rad", "angles have units"),
    row(Place::Call, "radians deg2rad to_radians torad deg", "$1 * 1deg", "angles have units"),
    row(Place::Call, "degrees rad2deg to_degrees todeg", "$1 / 1deg", "angles have units"),
    row(
        Place::Call,
        "rgb RGB vec3 vec3f float3 color Color color3f Vector Vector3 Vec3 Point3f Vector3f Color3f",
        "[$v]",
        "values side by side are an array",
    ),
    row(
        Place::Call,
        "rgba vec2 vec4 vec2f vec4f float2 float4 array tensor asarray list tuple Tensor as_tensor",
        "[$*]",
        "values side by side are an array",
    ),
    row(Place::Call, "str repr to_string toString format", "\"{$1}\"", "a string may hold values"),
    row(Place::Call, "int Int trunc", "floor($1)", ""),
    row(Place::Call, "float Float double f32 f64 number Number", "$1", "numbers are all of one kind"),
    row(
        Place::Call,
        "isclose allclose",
        "$1 ≈ $2 within 1%",
        "say how near: a percentage of the larger one, or a number",
    ),
    row(Place::Call, "saturate", "clamp($1, 0, 1)", ""),
    row(Place::Call, "relu", "max($1, 0)", ""),
    row(Place::Call, "inversesqrt rsqrt inverse_sqrt invsqrt", "1 / sqrt($1)", ""),
    row(Place::Call, "hypot", "norm([$1, $2])", ""),
    row(Place::Call, "sinh", "(exp($1) - exp(-$1)) / 2", ""),
    row(Place::Call, "cosh", "(exp($1) + exp(-$1)) / 2", ""),
    row(Place::Call, "expm1", "exp($1) - 1", ""),
    row(Place::Call, "log1p", "log(1 + $1)", ""),
    row(Place::Call, "softplus", "log(1 + exp($1))", ""),
    row(Place::Call, "logit", "log($1 / (1 - $1))", ""),
    row(Place::Call, "step", "where($2 < $1, 0, 1)", ""),
    row(Place::Call, "add", "$1 + $2", ""),
    row(Place::Call, "sub subtract", "$1 - $2", ""),
    row(Place::Call, "mul multiply", "$1 * $2", ""),
    row(Place::Call, "div divide", "$1 / $2", ""),
    row(Place::Call, "power", "$1 ^ $2", ""),
    row(Place::Call, "matmul mm mv bmm", "$1 @ $2", ""),
    row(Place::Call, "outer", "[[a * b for b in $2] for a in $1]", ""),
    row(Place::Call, "identity eye", "[[if i == j then 1 else 0 for j in 0..$1] for i in 0..$1]", ""),
    row(Place::Call, "xor logical_xor", "$1 != $2", ""),
    row(Place::Call, "logical_and", "$1 and $2", ""),
    row(Place::Call, "logical_or", "$1 or $2", ""),
    row(Place::Call, "logical_not", "not $1", ""),
    row(Place::Call, "cumsum", "[sum($1[0..i + 1]) for i in 0..len($1)]", ""),
    row(Place::Call, "prod product", "exp(sum(log($1)))", "if all are above 0"),
    row(Place::Call, "reverse reversed", "[$1[-1 - i] for i in 0..len($1)]", ""),
    row(
        Place::Call,
        "reduce fold foldl accumulate",
        "",
        "many values become one by `sum(…)`, `mean(…)`, `min(…)`, `max(…)`, `any(…)` or `all(…)`",
    ),
    row(Place::Call, "fract frac", "$1 - floor($1)", ""),
    row(Place::Call, "reflect", "$1 - 2 * dot($1, $2) * $2", ""),
    row(Place::Call, "square sqr", "$1 ^ 2", ""),
    row(Place::Call, "cbrt", "$1 ^ (1 / 3)", ""),
    row(Place::Call, "exp2", "2 ^ $1", ""),
    row(Place::Call, "log2", "log($1) / log(2)", ""),
    row(Place::Call, "log10", "log($1) / log(10)", ""),
    row(Place::Call, "append push cons", "concat($1, [$2])", ""),
    row(Place::Call, "map", "[$1(x) for x in $2]", "functions are applied by a comprehension"),
    row(Place::Call, "filter", "[x for x in $2 if $1(x)]", ""),
    row(Place::Call, "enumerate", "zip(0..len($1), $1)", ""),
    row(Place::Call, "rand random", "uniform($1)", ""),
    row(Place::Call, "rand random", "uniform(1)[0]", ""),
    row(Place::Call, "randn normal_noise", "noise($1)", ""),
    row(
        Place::Call,
        "twosided two_sided TwoSided",
        "$1",
        "every material has two sides; `one_sided(…)` takes one away",
    ),
    row(
        Place::Call,
        "emissive emission",
        "area(NAME, radiance: $1)",
        "what shines is a light, whose mesh may have a `material`",
    ),
    row(Place::Call, "glass", "dielectric(ior: 1.5)", ""),
    row(Place::Call, "roughdielectric rough_dielectric", "dielectric(ior: 1.5, roughness: 0.3)", ""),
    row(Place::Call, "thindielectric window", "thin_dielectric()", ""),
    row(
        Place::Call,
        "load_dict load_file load_string",
        "",
        "scenes of other programs are not read: what is in them is declared; of glTF, `load_shapes(\"….glb\")` brings the shapes",
    ),
    row(Place::Call, "traverse", "", "what moves is declared as a param: `param NAME = …`"),
    row(Place::Name, "this self", "", "there are no objects: what is meant is called by the name of its declaration"),
    row(
        Place::Name,
        "iTime iResolution iMouse gl_FragCoord fragCoord gl_FragColor",
        "",
        "there are no shaders: what varies over a surface is a texture, and pictures are made by `render(…)`",
    ),
    row(Place::Name, "end", "-1", "the last element has the index -1"),
    row(Place::Name, "True TRUE yes on", "true", ""),
    row(Place::Name, "False FALSE no off", "false", ""),
    row(
        Place::Name,
        "None none null nil undefined NULL nullptr Null",
        "",
        "there is no empty value; of a field or argument, leave it out",
    ),
    row(Place::Name, "PI M_PI Pi", "pi", ""),
    row(Place::Name, "tau TAU TWO_PI two_pi M_2PI", "2 * pi", ""),
    row(Place::Name, "half_pi HALF_PI M_PI_2", "pi / 2", ""),
    row(Place::Name, "e E M_E", "exp(1)", ""),
    row(
        Place::Name,
        "nan NaN NAN Nan",
        "",
        "what is not a number cannot be written; `is_nan(…)` asks whether something is one",
    ),
    row(
        Place::Name,
        "inf Inf INF Infinity infinity INFINITY ∞",
        "1e9",
        "there is no infinite number; write a large one",
    ),
    row(Place::Method, "map", "[$1(x) for x in $<]", "functions are applied by a comprehension"),
    row(Place::Method, "filter", "[x for x in $< if $1(x)]", ""),
    row(Place::Method, "append push push_back add extend", "concat($<, [$1])", ""),
    row(Place::Method, "shape size length count len", "len($<)", ""),
    row(Place::Method, "T", "transpose($<)", ""),
    row(Place::Method, "value data item numpy cpu clone copy tolist to_list", "$<", "a value needs no conversion"),
    row(Place::Method, "detach", "stop_gradient($<)", ""),
    row(Place::Method, "backward gradient", "grad($<)", ""),
    row(Place::Method, "toString to_string", "\"{$<}\"", "a string may hold values"),
    row(Place::Method, "save write", "save $< to $1", "saving is a statement"),
    row(Place::Method, "requires_grad requires_grad_", "param NAME = $<", "what moves is declared so"),
];

/// Modules of other languages, whose functions are simply there in this one.
pub fn is_module(name: &str) -> bool {
    const MODULES: &str = "np numpy torch math Math tf jnp jax mi dr mitsuba drjit glm bpy F nn cp scipy THREE std plt matplotlib \
                           cv2 PIL imageio pytorch3d nvdiffrast o3d trimesh sys os";
    MODULES.split(' ').any(|m| m == name)
}

/// What arrays are called in types elsewhere: `list[int]`.
pub fn is_array_type(name: &str) -> bool {
    "list List Array array Vec vector tuple Tuple Sequence".split(' ').any(|t| t == name)
}

/// Written before a string elsewhere: `f"…"`.
pub fn is_string_prefix(word: &str) -> bool {
    "f r b u F R B U fr rf".split(' ').any(|p| p == word)
}

/// The help for a foreign spelling: why, and the text to type.
pub fn help(place: Place, spelling: &str, around: &Around) -> Option<String> {
    let mut around = around.clone();
    // `map(xs, x => 2 * x)`: the function comes first in some languages, the array in others.
    if let ("map" | "filter", [a, b]) = (spelling, around.arguments.as_mut_slice())
        && (b.contains("=>") || b.trim_start().starts_with("lambda "))
        && !a.contains("=>")
    {
        std::mem::swap(a, b);
    }
    // A number that was read from a file or a command line, elsewhere.
    if let (Place::Call, "int" | "Int" | "float" | "Float", [text]) = (place, spelling, around.arguments.as_mut_slice())
        && let Some(number) = text.trim().strip_prefix('"').and_then(|t| t.strip_suffix('"'))
        && number.parse::<f64>().is_ok()
    {
        return Some(format!("write `{number}`"));
    }
    if let (Place::Call, Some(typed)) = (place, filled(spelling, &around.arguments)) {
        return Some(format!("write `{typed}`"));
    }
    let around = &around;
    let text = |row: &&Row| {
        (row.place == place && row.spellings.split(' ').any(|s| s == spelling)).then(|| fill(row.write, around))?
    };
    let row = TABLE.iter().find(|row| text(row).is_some())?;
    let typed = inlined(row.write, around).or_else(|| text(&row))?;
    Some(match (row.why, typed.as_str()) {
        ("", _) => format!("write `{typed}`"),
        (why, "") => why.to_owned(),
        (why, _) => format!("{why}: `{typed}`"),
    })
}

/// An array of equal numbers: `zeros(3)`, `zeros([2, 3])`, `zeros(2, 3)`, `full((2, 3), 0.5)`.
fn filled(spelling: &str, arguments: &[&str]) -> Option<String> {
    const COUNTERS: [&str; 4] = ["i", "j", "k", "l"];
    let size = match spelling {
        "mat2" | "Matrix2" => 2,
        "mat3" | "Matrix3" => 3,
        "mat4" | "Matrix4" | "Matrix4f" => 4,
        _ => 0,
    };
    if size > 0 {
        return match arguments {
            [one] if !one.starts_with('[') => {
                Some(format!("[[if i == j then {one} else 0 for j in 0..{size}] for i in 0..{size}]"))
            }
            all if all.len() == size * size => {
                let rows: Vec<String> = all.chunks(size).map(|row| format!("[{}]", row.join(", "))).collect();
                Some(format!("[{}]", rows.join(", ")))
            }
            all if !all.is_empty() => Some(format!("[{}]", all.join(", "))),
            _ => None,
        };
    }
    let (value, sizes) = match (spelling, arguments) {
        ("zeros", sizes) => ("0", sizes),
        ("ones", sizes) => ("1", sizes),
        ("full" | "fill", [size, value]) => (*value, std::slice::from_ref(size)),
        _ => return None,
    };
    let unnamed = |text: &str| text.split_once(':').map_or(text, |(_, value)| value).trim().to_owned();
    let (value, first) = (unnamed(value), unnamed(sizes.first()?));
    let listed = first.strip_prefix(['[', '(']).and_then(|list| list.strip_suffix([']', ')']));
    let sizes: Vec<&str> = match listed {
        Some(list) => list.split(',').map(str::trim).filter(|size| !size.is_empty()).collect(),
        None => {
            std::iter::once(first.as_str()).chain(sizes[1..].iter().copied().filter(|s| !s.contains('='))).collect()
        }
    };
    let loops = sizes.iter().zip(COUNTERS).rev();
    (sizes.len() <= COUNTERS.len())
        .then(|| loops.fold(value, |inner, (size, counter)| format!("[{inner} for {counter} in 0..{size}]")))
}

/// A template that calls its first argument, `$1(x)`, if that is a function value, `x => 2 * x`: with its body in place of the call.
fn inlined(template: &str, around: &Around) -> Option<String> {
    let (name, body) = around.arguments.first()?.split_once("=>")?;
    let (name, body) = (name.trim(), body.trim());
    let is_name = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
    if !is_name || body.contains('$') || !template.contains("$1(x)") {
        return None;
    }
    let named = template.replace(" x in", &format!(" {name} in")).replace("[x ", &format!("[{name} "));
    fill(&named.replace("$1(x)", body), around)
}

/// Operators of other languages, for the parser: longest first.
pub fn operators() -> Vec<&'static str> {
    let rows = TABLE.iter().filter(|r| matches!(r.place, Place::Operator | Place::Postfix));
    let mut all: Vec<&str> = rows.flat_map(|r| r.spellings.split(' ')).collect();
    all.sort_unstable_by_key(|s| std::cmp::Reverse(s.len()));
    all
}

/// A template with what the user wrote; `None` if it needs what is not there.
fn fill(template: &str, around: &Around) -> Option<String> {
    let one_line = |text: &str| text.split_whitespace().collect::<Vec<&str>>().join(" ");
    let present = |text: &str| (!text.trim().is_empty()).then(|| one_line(text));
    let mut out = String::new();
    let mut rest = template;
    while let Some((text, after)) = rest.split_once('$') {
        out.push_str(text);
        let mut chars = after.chars();
        let what = chars.next()?;
        rest = chars.as_str();
        let value = match what {
            '<' => present(around.before)?,
            // `√(1 + x)` has its brackets.
            '>' if out.ends_with('(') && rest.starts_with(')') && around.behind.starts_with('(') => {
                out.pop();
                rest = rest.strip_prefix(')').unwrap_or(rest);
                present(around.behind)?
            }
            '>' => present(around.behind)?,
            'v' if let [one] = around.arguments.as_slice()
                && one.trim().parse::<f64>().is_ok() =>
            {
                [one.trim(); 3].join(", ")
            }
            '*' | 'v' => {
                // `array([1, 2])` has its brackets.
                if let ([one], true) = (around.arguments.as_slice(), out.ends_with('['))
                    && one.trim_start().starts_with('[')
                {
                    out.pop();
                    rest = rest.strip_prefix(']').unwrap_or(rest);
                    one_line(one)
                } else {
                    present(&around.arguments.join(", "))?
                }
            }
            digit => present(around.arguments.get(digit.to_digit(10)?.checked_sub(1)? as usize)?)?,
        };
        // What has an operator is put into brackets beside another one.
        let beside = [out.trim_end().chars().next_back(), rest.trim_start().chars().next()];
        let bare = beside.iter().all(|c| c.is_none_or(|c| "([{,=\")]}:.".contains(c)));
        let compound = what.is_ascii_digit()
            && !bare
            && value.contains(|c: char| "+-*/^<>=".contains(c))
            && !value.starts_with('(');
        if compound { out.push_str(&format!("({value})")) } else { out.push_str(&value) }
    }
    out.push_str(rest);
    Some(out)
}

/// Functions of another thing under a name that is taken here: the name, the type of its first argument, and what to write.
const INSTEAD: &[(&str, &str, &str, &str)] = &[
    (
        "area",
        "mesh",
        "surface_area($1)",
        "a light with a radiance is an `area`, how large a surface is has another name",
    ),
    ("gradient", "scalar", "grad($1, $2)", "derivatives have another name"),
    ("mix", "material", "blend($1, $2, weight: $3)", "materials are blended"),
    ("mix", "material", "blend($1, $2, weight: 0.5)", "materials are blended"),
    ("translate", "scalar", "translation([$1, $2, $3])", "a transform without a mesh has another name"),
    ("translate", "vec3", "translation($1)", "a transform without a mesh has another name"),
    ("scale", "scalar", "scaling([$1, $2, $3])", "a transform without a mesh has another name"),
    ("scale", "scalar", "scaling($1)", "a transform without a mesh has another name"),
    ("scale", "vec3", "scaling($1)", "a transform without a mesh has another name"),
    ("rotate", "vec3", "rotation($1, $2)", "a rotation without a mesh has another name"),
    ("rotate", "rotation", "$1 @ NAME", "what is turned is missing"),
    ("where", "bool[]", "[if b then $2 else $3 for b in …]", "of a list, each item chooses"),
];

/// What to write instead of a call of `function` whose first argument is of the type `first`, which it does not take.
pub fn instead(function: &str, first: &str, around: &Around) -> Option<String> {
    let any_length = first.split_once('[').map_or(String::new(), |(item, _)| format!("{item}[]"));
    let known = |row: &&(&str, &str, &str, &str)| row.0 == function && (row.1 == first || row.1 == any_length);
    INSTEAD.iter().filter(known).find_map(|(.., write, why)| Some(format!("{why}: `{}`", fill(write, around)?)))
}

/// What the language will have and this version has not.
pub fn is_planned(name: &str) -> bool {
    const FUNCTIONS: &str = "decimate unwrap medium";
    FUNCTIONS.split_whitespace().any(|planned| planned == name)
}

/// Something that is planned was used.
pub fn unavailable(name: &str, span: Span) -> Diagnostic {
    Diagnostic::error("dscene::feature::unavailable", format!("`{name}` is not available yet"))
        .label(span, "not in this version")
}
