//! Statements of scene formats and shading languages: Mitsuba's XML, the directives of PBRT, lines of OBJ files, declarations of GLSL.
//! Which one it is, and what to type for it.

use super::{dicts, leading_word};
use crate::diag::advice;
use crate::syntax::scan::{KINDS, is_directive, statement_words};
use crate::syntax::snippet::{closing, parts};

/// A statement of another language.
pub struct Foreign {
    /// What it is told as: of each language once, since a script in it is one mistake.
    pub language: &'static str,
    /// The place of its first word.
    pub start: usize,
    pub end: usize,
    pub help: String,
}

/// Which language a statement is of, if it is one of these.
pub fn find(text: &str) -> Option<Foreign> {
    let start = text.len() - text.trim_start().len();
    let rest = text.trim();
    let (language, length, help) = match rest.strip_prefix('<') {
        Some(tag) => ("XML", 1 + tag.find(|c: char| !is_tag(c)).unwrap_or(tag.len()), element(rest)),
        None => {
            let word = leading_word(rest);
            let behind = rest.get(word.len()..)?.trim();
            if let Some((language, help)) = dicts::section(rest) {
                (language, rest.lines().next().map_or(1, |line| line.trim_end().len()), help)
            } else if is_directive(word) && is_arguments(behind) {
                ("PBRT", word.len(), directive(word, behind))
            } else if is_of_mesh(word, behind) {
                ("OBJ", word.len(), "a mesh in a file is loaded: `mesh NAME = load(\"….obj\")`".to_owned())
            } else {
                ("GLSL", word.len(), shading(word, behind)?)
            }
        }
    };
    Some(Foreign { language, start, end: start + length, help })
}

/// Whether a statement is one of a program in Python: `mi.set_variant("…")`, `image = mi.render(scene)`.
pub fn is_python(text: &str) -> bool {
    let begins = |text: &str| {
        let word = leading_word(text.trim_start());
        advice::is_module(word) && word != "std" && text.trim_start()[word.len()..].starts_with('.')
    };
    let is_declared = statement_words().any(|word| word == leading_word(text.trim_start()) && !KINDS.contains(&word));
    !is_declared && (begins(text) || text.split_once('=').is_some_and(|(_, value)| begins(value)))
}

fn is_tag(c: char) -> bool {
    c.is_ascii_alphanumeric() || matches!(c, '_' | '?' | '!' | '/')
}

/// Whether something may follow a directive: nothing, or texts and numbers side by side.
fn is_arguments(text: &str) -> bool {
    text.is_empty()
        || text.starts_with(|c: char| c.is_ascii_digit() || c == '"' || c == '-' || c.is_ascii_uppercase())
        || text.starts_with('[') && !text.contains('=')
}

/// Whether a line is one of an OBJ file: `v 0 1 0`, `f 1/1 2/2 3/3`.
fn is_of_mesh(word: &str, behind: &str) -> bool {
    let numbers = behind.lines().next().unwrap_or("").split_whitespace();
    let is_number = |word: &str| word.split('/').all(|part| part.is_empty() || part.parse::<f64>().is_ok());
    matches!(word, "v" | "vn" | "vt" | "f") && numbers.clone().count() > 1 && numbers.into_iter().all(is_number)
}

/// The help for an element of XML, by the first one within that says something.
fn element(text: &str) -> String {
    if let Some(comment) = text.strip_prefix("<!--") {
        let inside = comment.split("-->").next().unwrap_or("").trim();
        return format!("a comment is written `// {}`", inside.lines().next().unwrap_or(""));
    }
    let typed = text.split('<').skip(1).find_map(|tag| {
        let name = leading_word(tag);
        let within = &text[text.find(tag)?..];
        let (kind, value) = (attribute(tag, "type").unwrap_or(""), |name: &str| property(within, name));
        Some(match name {
            "shape" => in_shape(kind, value("radius").as_deref()),
            "bsdf" => format!("material NAME = {}", material(kind, value("reflectance"))),
            "sensor" => format!("camera NAME {{ fov: {}deg }}", value("fov").unwrap_or("45".to_owned())),
            "emitter" => light(kind, value("radiance").or(value("irradiance"))),
            "integrator" => "integrator NAME { max_bounces: 8 }".to_owned(),
            "default" => format!("let {} = {}", attribute(tag, "name")?, attribute(tag, "value")?),
            _ => return None,
        })
    });
    let typed = typed.unwrap_or_else(|| in_shape("sphere", None));
    format!("scenes of XML are not read; what is in them is declared: `{typed}`")
}

/// `type="sphere"` of a tag.
fn attribute<'t>(tag: &'t str, name: &str) -> Option<&'t str> {
    let tag = tag.split('>').next()?;
    tag.split_once(&format!("{name}=\""))?.1.split('"').next()
}

/// `<float name="radius" value="1"/>` within an element; several numbers are an array.
fn property(text: &str, name: &str) -> Option<String> {
    let tag = text.split('<').find(|tag| attribute(tag, "name") == Some(name))?;
    Some(array(attribute(tag, "value")?))
}

/// The help for a directive of PBRT.
fn directive(word: &str, behind: &str) -> String {
    let kind = behind.strip_prefix('"').and_then(|rest| rest.split('"').next()).unwrap_or("");
    let named = |name: &str| parameter(behind, name);
    let typed = match word {
        "Shape" => in_shape(kind, named("radius").as_deref()),
        "Material" | "MakeNamedMaterial" => {
            let kind = named("type").map_or(kind.to_owned(), |of| of.trim_matches('"').to_owned());
            format!("material NAME = {}", material(&kind, named("reflectance").or(named("Kd"))))
        }
        "LightSource" => light(kind, named("L").or(named("I"))),
        "AreaLightSource" => {
            format!("light NAME = area(…, radiance: {})", named("L").unwrap_or_else(|| "1".to_owned()))
        }
        "Camera" => format!("camera NAME {{ fov: {}deg }}", named("fov").unwrap_or_else(|| "45".to_owned())),
        "Film" => {
            let size = |name: &str| named(name).unwrap_or_else(|| "256".to_owned());
            format!("camera NAME {{ film: [{}, {}] }}", size("xresolution"), size("yresolution"))
        }
        "LookAt" => {
            let numbers: Vec<&str> = behind.split_whitespace().collect();
            let Some([position, target]) = numbers.get(..6).map(|all| [&all[..3], &all[3..]].map(|v| v.join(", ")))
            else {
                return "a camera has fields: `camera NAME { position: …, look_at: …, fov: … }`".to_owned();
            };
            format!("camera NAME {{ position: [{position}], look_at: [{target}] }}")
        }
        "Translate" => format!("let NAME = translate(…, {})", array(behind)),
        "Scale" => format!("let NAME = scale(…, {})", array(behind)),
        "Rotate" => {
            let (angle, axis) = behind.split_once(' ').unwrap_or((behind, "0 1 0"));
            format!("let NAME = rotate(…, axis: {}, angle: {angle}deg)", array(axis))
        }
        "Sampler" => {
            let samples = named("pixelsamples").unwrap_or_else(|| "16".to_owned());
            format!("let NAME = render(…, spp: {samples})")
        }
        "Integrator" => "integrator NAME { max_bounces: 8 }".to_owned(),
        "Texture" => "texture NAME = texture(…)".to_owned(),
        _ => return "scenes of PBRT are not read, and nothing stands for this: leave it out".to_owned(),
    };
    format!("scenes of PBRT are not read; what is in them is declared: `{typed}`")
}

/// The value behind `"float radius"`.
fn parameter(text: &str, name: &str) -> Option<String> {
    let (_, value) = text.split_once(&format!(" {name}\""))?;
    let value = value.trim_start();
    Some(match value.strip_prefix('[') {
        Some(inside) => array(inside.split(']').next()?),
        None => value.split_whitespace().next()?.to_owned(),
    })
}

/// Numbers side by side as one value.
fn array(numbers: &str) -> String {
    let all: Vec<&str> = numbers.split([' ', ',', '\t', '\n']).filter(|word| !word.is_empty()).collect();
    if let [one] = all[..] { one.to_owned() } else { format!("[{}]", all.join(", ")) }
}

fn in_shape(kind: &str, radius: Option<&str>) -> String {
    let sized = |name: &str| format!("{name}({})", radius.map_or(String::new(), |r| format!("radius: {r}")));
    let mesh = match kind {
        "disk" | "cylinder" | "cone" => sized(kind),
        "cube" | "rectangle" => format!("{kind}()"),
        "obj" | "ply" | "plymesh" => "load(…)".to_owned(),
        "trianglemesh" => "mesh(…)".to_owned(),
        _ => sized("sphere"),
    };
    format!("shape NAME {{ mesh: {mesh}, material: diffuse() }}")
}

fn material(kind: &str, reflectance: Option<String>) -> String {
    match kind {
        "glass" | "dielectric" | "thindielectric" | "roughdielectric" => "dielectric()".to_owned(),
        "mirror" => "mirror()".to_owned(),
        "conductor" | "roughconductor" | "metal" => "conductor()".to_owned(),
        "plastic" | "roughplastic" | "coateddiffuse" | "substrate" => "plastic()".to_owned(),
        "principled" | "disney" | "uber" => "principled()".to_owned(),
        _ => format!("diffuse({})", reflectance.unwrap_or_default()),
    }
}

fn light(kind: &str, radiance: Option<String>) -> String {
    let radiance = radiance.unwrap_or_else(|| "1".to_owned());
    match kind {
        "distant" | "directional" => "light NAME = directional(direction: …)".to_owned(),
        "point" => "light NAME = point(position: …)".to_owned(),
        "spot" => "light NAME = spot(position: …, direction: …)".to_owned(),
        "area" => format!("light NAME = area(…, radiance: {radiance})"),
        "envmap" => "light NAME = environment(…)".to_owned(),
        _ => format!("light NAME = constant({radiance})"),
    }
}

/// The help for a declaration of GLSL, with `behind` what stands behind its first word.
fn shading(word: &str, behind: &str) -> Option<String> {
    let second = leading_word(behind);
    let third = leading_word(behind.get(second.len()..)?.trim_start());
    Some(match word {
        "uniform" if !third.is_empty() => {
            let value = behind.split(';').next()?.split_once('=').map(|(_, value)| value.trim());
            format!("what is given from outside is a param: `param {third} = {}`", value.unwrap_or(zero(second)?))
        }
        "in" | "out" | "varying" | "attribute" if !third.is_empty() => {
            zero(second)?;
            "there are no shaders: what varies over a surface is a texture, as in `diffuse(texture(…))`".to_owned()
        }
        "layout" if behind.starts_with('(') => "there are no shaders: leave it out".to_owned(),
        "precision" if matches!(second, "highp" | "mediump" | "lowp") => "leave it out".to_owned(),
        _ if word == "void" || zero(word).is_some() => {
            let function = behind.get(second.len()..)?.trim_start();
            let close = function.starts_with('(').then(|| closing(function, 0))??;
            let names = parts(function.get(1..close)?);
            let names: Vec<&str> = names.iter().filter_map(|param| param.split_whitespace().last()).collect();
            let body = function.get(close + 1..)?.trim().strip_prefix('{')?.trim_end().trim_end_matches('}').trim();
            let body = body.strip_prefix("return ").map(|body| body.trim().trim_end_matches(';'));
            let body = body.filter(|body| !body.contains([';', '\n'])).unwrap_or("…");
            format!("a function is declared without types: `fn {second}({}) = {body}`", names.join(", "))
        }
        _ => return None,
    })
}

/// A value of a type of GLSL.
fn zero(ty: &str) -> Option<&'static str> {
    Some(match ty {
        "float" | "int" | "double" | "bool" => "0",
        "vec2" => "[0, 0]",
        "vec3" => "[0, 0, 0]",
        "vec4" => "[0, 0, 0, 0]",
        "mat3" | "mat4" | "sampler2D" => "…",
        _ => return None,
    })
}
