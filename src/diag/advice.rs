//! What people write who come from Python, GLSL, JavaScript, Mitsuba, PBRT, Blender or PyTorch, and what is written here
//! instead. Everything that the language knows of other languages stands in this file; parser and checker ask it with
//! what they found and where, and every row is a test (`tests/scripts/advice.rs`).

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
    row(Place::Operator, "&& &", "$< and $>", ""),
    row(Place::Operator, "||", "$< or $>", ""),
    row(Place::Operator, "! ~", "not $>", ""),
    row(Place::Operator, "**", "$< ^ $>", ""),
    row(Place::Operator, "<> !== =/= /= ≠", "$< != $>", ""),
    row(Place::Operator, "^^ xor", "$< != $>", ""),
    row(Place::Operator, "∧", "$< and $>", ""),
    row(Place::Operator, "∨ |", "$< or $>", ""),
    row(Place::Operator, "¬", "not $>", ""),
    row(Place::Operator, "≤ ⩽", "$< <= $>", ""),
    row(Place::Operator, "≥ ⩾", "$< >= $>", ""),
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
    row(Place::Call, "repeat", "[$1 for i in 0..$2]", ""),
    row(Place::Call, "zeros_like", "0 * $1", ""),
    row(Place::Call, "ones_like", "0 * $1 + 1", ""),
    row(Place::Call, "range arange iota", "$1..$2", ""),
    row(Place::Call, "range arange iota", "0..$1", ""),
    row(Place::Call, "radians deg2rad to_radians torad", "$1 * 1deg", "angles have units"),
    row(Place::Call, "degrees rad2deg to_degrees todeg", "$1 / 1deg", "angles have units"),
    row(
        Place::Call,
        "rgb RGB vec3 float3 color Color color3f Vector Vector3 Vec3 Point3f Vector3f Color3f",
        "[$v]",
        "values side by side are an array",
    ),
    row(
        Place::Call,
        "rgba vec2 vec4 float2 float4 array tensor asarray list tuple Tensor as_tensor",
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
    const MODULES: &str = "np numpy torch math Math tf jnp jax mi dr mitsuba drjit glm bpy F nn cp scipy THREE std";
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

/// The field or argument that `name` is called here, given what the callee has.
pub fn field(name: &str, known: &[&str]) -> Option<&'static str> {
    let candidates: &[&'static str] = match name.to_lowercase().as_str() {
        "albedo" | "kd" | "rho" | "diffuse_reflectance" | "base_colour" | "basecolor" => {
            &["reflectance", "diffuse", "base_color"]
        }
        "color" | "colour" => &["reflectance", "base_color", "radiance", "intensity", "irradiance", "diffuse"],
        "ks" | "specular_reflectance" => &["specular", "reflectance"],
        "alpha" => &["roughness", "opacity"],
        "eta" | "int_ior" | "refractive_index" | "index_of_refraction" | "n" => &["ior"],
        "dim" | "dims" | "axes" => &["axis"],
        "clearcoat" | "clearcoat_weight" | "coat_weight" => &["coat"],
        "clearcoat_roughness" => &["coat_roughness"],
        "anisotropic" | "anisotropy_strength" => &["anisotropy"],
        "anisotropy_rotation" => &["turn"],
        "bump" | "bump_map" | "height_map" => &["heights"],
        "mask" | "weights" => &["weight"],
        "glossiness" | "shininess" | "exponent" => &["roughness"],
        "normal" | "normal_texture" | "map" | "texture" => &["normals"],
        "opacity_map" | "alpha_map" | "coverage" | "transparency" => &["opacity"],
        "ies" | "ies_file" | "photometry" | "distribution" => &["profile"],
        "bsdf" | "brdf" | "shader" => &["material"],
        "geometry" | "shape" | "primitive" | "model" => &["mesh"],
        "lookat" | "target" | "center" | "at" | "focus_point" => &["look_at"],
        "origin" | "eye" | "pos" | "location" | "from" => &["position"],
        "window" | "region" | "crop_window" | "viewport" | "roi" => &["crop"],
        "rfilter" | "pixel_filter" | "reconstruction_filter" => &["filter"],
        "sensor" | "resolution" | "size" | "pixels" | "image_size" => &["film", "camera"],
        "fovy" | "field_of_view" | "angle" | "fov_y" => &["fov"],
        "fovx" => &["fov_x"],
        "cutoff_angle" | "outer_angle" | "outer_cone_angle" | "cone_angle" => &["cutoff"],
        "beam_width" | "inner_angle" | "inner_cone_angle" => &["beam"],
        "aperture_radius" | "lens_radius" => &["aperture"],
        "focus_distance" | "focal_distance" | "focus_depth" => &["focus"],
        "distortion_params" | "dist_coeffs" | "radial_distortion" | "lens_distortion" => &["distortion"],
        "shutter_open" | "shutter_close" | "exposure" => &["shutter"],
        "type" | "projection" | "model_type" => &["kind"],
        "to_world" | "matrix" | "pose" => &["transform"],
        "emission" | "power" | "intensity" | "energy" | "strength" | "le" => &["radiance", "intensity", "irradiance"],
        "emitters" | "lamps" => &["lights"],
        "objects" | "meshes" => &["shapes"],
        "samples" | "sample_count" | "samples_per_pixel" | "num_samples" => &["spp"],
        "max_depth" | "depth" | "bounces" | "maxdepth" => &["max_bounces"],
        "learning_rate" | "rate" | "step_size" | "stepsize" => &["lr"],
        "beta_1" => &["beta1"],
        "beta_2" => &["beta2"],
        "eps" => &["epsilon"],
        "optimizer" | "optimiser" | "with" | "solver" | "method" => &["using"],
        "iterations" | "epochs" | "iters" | "max_steps" => &["steps"],
        "params" | "parameters" | "wrt" | "variables" => &["over"],
        "freeze" | "fixed" | "locked" => &["frozen"],
        "indices" | "triangles" | "tris" => &["faces"],
        "points" | "positions" | "verts" => &["vertices"],
        "texcoords" | "uv" | "st" => &["uvs"],
        "filename" | "file" => &["path", "source", "image"],
        "r" => &["radius"],
        "radius" => &["distance"],
        "w" => &["width"],
        "h" => &["height"],
        "width" | "height" => &["film"],
        "length" => &["depth", "height"],
        "segments" | "resolution_u" | "detail" | "level" | "levels" | "sides" => &["subdivisions"],
        "by" | "amount" | "vector" | "translation" => &["offset", "factor"],
        _ => &[],
    };
    candidates.iter().find(|c| known.contains(c)).copied()
}

/// What is set in a solver, not in `optimize`: the solver and its setting.
pub fn solver_setting(name: &str) -> Option<(&'static str, &'static str)> {
    Some(match name.to_lowercase().as_str() {
        "lr" | "learning_rate" | "rate" | "step_size" | "stepsize" => ("adam", "lr"),
        "beta1" | "beta_1" => ("adam", "beta1"),
        "beta2" | "beta_2" => ("adam", "beta2"),
        "epsilon" | "eps" => ("adam", "epsilon"),
        "momentum" => ("sgd", "momentum"),
        "nesterov" => ("sgd", "nesterov"),
        "damping" => ("levenberg_marquardt", "damping"),
        _ => return None,
    })
}

/// What to write in a stage or in `optimize` in place of a list of what stands still.
pub fn standing_still(name: &str) -> Option<&'static str> {
    let is_list = ["freeze", "frozen", "fixed", "locked", "except"].contains(&name.to_lowercase().as_str());
    is_list.then_some("say what moves, all else stands still: `over: […]`")
}

/// The light that has such an argument, which the fields of `light NAME { … }` (an area light) have not.
pub fn light_with(argument: &str) -> Option<&'static str> {
    Some(match argument {
        "position" | "intensity" | "profile" => "point",
        "direction" | "irradiance" => "directional",
        "cutoff" | "beam" => "spot",
        "image" | "rotation" => "environment",
        _ => return None,
    })
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
];

/// What to write instead of a call of `function` whose first argument is of the type `first`, which it does not take.
pub fn instead(function: &str, first: &str, around: &Around) -> Option<String> {
    let known = |row: &&(&str, &str, &str, &str)| row.0 == function && row.1 == first;
    INSTEAD.iter().filter(known).find_map(|(.., write, why)| Some(format!("{why}: `{}`", fill(write, around)?)))
}

/// The function around a material that says what elsewhere an argument of the material does.
pub fn around_material(argument: &str) -> Option<&'static str> {
    Some(match argument.to_lowercase().as_str() {
        "clearcoat" | "clearcoat_weight" | "clearcoat_roughness" | "coat" | "coat_weight" | "coat_roughness" => {
            "coated"
        }
        "anisotropy" | "anisotropic" | "anisotropy_strength" | "anisotropy_rotation" | "alpha_u" | "alpha_v" => {
            "brushed"
        }
        "normal" | "normals" | "normal_map" | "normal_texture" => "normal_map",
        "bump" | "bump_map" | "height_map" => "bump",
        "opacity" | "opacity_map" | "mask" | "cutout" => "mask",
        "one_sided" => "one_sided",
        _ => return None,
    })
}

/// What a light has for an argument that it has not: a point with a profile is turned.
pub fn of_light(light: &str, argument: &str) -> Option<&'static str> {
    match (light, argument.to_lowercase().as_str()) {
        ("point", "direction" | "aim" | "target" | "look_at" | "to" | "axis") => {
            Some("a `profile` is turned by `rotation: aim(…)`; light in a cone is a `spot`")
        }
        _ => None,
    }
}

/// The function that `name` is called here.
pub fn function(name: &str) -> Option<&'static str> {
    Some(match name.to_lowercase().as_str() {
        "lambertian" | "lambert" | "matte" => "diffuse",
        "metal" | "roughconductor" | "ggx" => "conductor",
        "sheen" | "velvet" | "fabric" | "charlie" => "cloth",
        "clearcoat" | "clear_coat" | "coat" | "varnish" | "lacquer" => "coated",
        "anisotropic" | "ward" | "grooves" => "brushed",
        "normalmap" | "normal_texture" | "normals_map" => "normal_map",
        "blendbsdf" | "blend_bsdf" | "mix_shader" | "mix_material" | "mixture" => "blend",
        "bumpmap" | "bump_map" | "height_map" => "bump",
        "sun_sky" | "daylight" | "hosek" | "preetham" | "nishita" => "sunsky",
        "cutout" | "alpha_mask" | "opacity_mask" => "mask",
        "plane" | "quad" | "rect" | "square" => "rectangle",
        "box" => "cube",
        "envmap" | "environment_map" | "infinite" | "ibl" => "environment",
        "emitter" | "area_light" | "arealight" => "area",
        "sun" | "distant" => "directional",
        "ambient" | "ambient_light" | "ambientlight" | "hemisphere" => "constant",
        "pointlight" | "point_light" | "goniometric" | "projector" | "ies" => "point",
        "load_ies" | "read_ies" | "ies_profile" | "photometry" => "load_profile",
        "perspective" | "sensor" | "pinhole" => "camera",
        "obj" | "ply" | "load_mesh" | "load_obj" | "import_mesh" => "load",
        "imread" | "read_image" | "open" => "load_image",
        "load_csv" | "read_csv" | "loadtxt" | "genfromtxt" | "read_table" => "load_table",
        "load_npy" | "read_npy" | "fromfile" => "load_array",
        "read_json" => "load_json",
        "bitmap" | "image_texture" => "texture",
        "gaussian" | "gaussian_blur" => "blur",
        "average" | "avg" => "mean",
        "maximum" | "fmax" => "max",
        "minimum" | "fmin" => "min",
        "fabs" | "absolute" => "abs",
        "ceiling" => "ceil",
        "sgn" | "signum" => "sign",
        "magnitude" => "norm",
        "normalise" | "normalized" | "normalised" | "unit_vector" => "normalize",
        "sorted" => "sort",
        "any_of" => "any",
        "all_of" => "all",
        "isnan" => "is_nan",
        "stddev" | "standard_deviation" => "std",
        "var" => "variance",
        "quantile" => "percentile",
        "clip" | "saturate" => "clamp",
        "fmod" | "modulo" | "remainder" => "mod",
        "select" | "cond" | "ifelse" => "where",
        "inv" | "invert" => "inverse",
        "det" => "determinant",
        "quat" => "quaternion",
        "cat" | "append" | "hstack" | "vstack" | "concatenate" => "concat",
        "grid_sample" | "bilinear" => "sample",
        "contact_sheet" | "make_grid" | "image_grid" | "tile" | "subplots" => "montage",
        "false_color" | "false_colour" | "falsecolor" | "colormap_image" | "cmap" | "apply_colormap" => "colormap",
        "linear_to_srgb" => "to_srgb",
        "srgb_to_linear" => "from_srgb",
        "bbox" | "bounding_box" | "aabb" => "bounds",
        "chamfer_distance" => "chamfer",
        "center_of_mass" | "barycenter" => "centroid",
        "project_points" | "world_to_screen" => "project",
        "lerp" => "mix",
        "ln" => "log",
        "sqr" | "square_root" => "sqrt",
        "arcsin" => "asin",
        "arccos" => "acos",
        "arctan" => "atan",
        "arctan2" => "atan2",
        "l2_loss" | "mean_squared_error" => "mse",
        "l1_loss" | "mae" => "l1",
        "iou" | "jaccard" | "dice" | "iou_loss" | "dice_loss" => "silhouette_iou",
        "lpips" | "lpips_loss" | "perceptual_loss" => "perceptual_error",
        "flip_loss" | "nvflip" => "flip_error",
        "bce" | "binary_cross_entropy" => "cross_entropy",
        "tv" | "tv_loss" => "total_variation",
        "edge_energy" | "edge_loss" | "mesh_edge_loss" => "edge_length_energy",
        "mesh_laplacian_smoothing" | "laplacian_loss" => "laplacian_energy",
        "mesh_normal_consistency" => "normal_consistency",
        "gradient_descent" => "sgd",
        "backward" | "gradients" => "grad",
        "move" | "shift" => "translate",
        "turn" => "rotate",
        "length_of" | "size" | "count" => "len",
        _ => return None,
    })
}

/// What is written in a `plot` for a field with that name.
pub fn plot_setting(name: &str) -> Option<&'static str> {
    Some(match name.to_lowercase().as_str() {
        "logx" | "log_x" | "semilogx" => "log: x",
        "logy" | "log_y" | "semilogy" | "yscale" | "scale" | "log_scale" | "logarithmic" => "log: y",
        "loglog" | "log_log" => "log: xy",
        "error" | "errors" | "yerr" | "std" | "error_band" | "errorbar" | "ci" => "band: …",
        "names" | "labels" | "label" => "legend: […]",
        "xlabel" | "x_title" | "xtitle" | "x_axis" | "x" => "x_label: \"…\"",
        "ylabel" | "y_title" | "ytitle" | "y_axis" | "y" => "y_label: \"…\"",
        "figsize" | "resolution" | "width" | "height" => "size: [640, 400]",
        _ => return None,
    })
}

/// The type that `name` is called here.
pub fn type_name(name: &str) -> Option<&'static str> {
    Some(match name.to_lowercase().as_str() {
        "float" | "double" | "real" | "f32" | "f64" | "num" => "scalar",
        "integer" | "i32" | "usize" => "int",
        "boolean" => "bool",
        "str" | "text" => "string",
        "rgb" | "colour" | "spectrum" => "color",
        "point3" | "vector3" | "float3" | "vector" | "point" => "vec3",
        "point2" | "float2" | "vector2" => "vec2",
        "matrix" | "mat" => "mat4",
        "tensor" | "ndarray" => "scalar[]",
        "bsdf" | "brdf" => "material",
        "emitter" => "light",
        "sensor" => "camera",
        "quaternion" | "quat" => "rotation",
        _ => return None,
    })
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
