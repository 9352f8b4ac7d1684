//! Scenes written as dictionaries and as sections: Mitsuba's `{'type': 'sphere'}`, YAML and TOML. What to type for each.

use super::leading_word;
use crate::syntax::scan::{KINDS, is_block};
use crate::syntax::snippet::parts;

/// Shapes, which have a mesh and a material.
const MESHES: [&str; 8] = ["sphere", "cube", "rectangle", "disk", "cylinder", "cone", "torus", "teapot"];
const MATERIALS: [&str; 7] = ["diffuse", "conductor", "dielectric", "plastic", "principled", "mirror", "phong"];
const LIGHTS: [&str; 6] = ["point", "spot", "directional", "constant", "environment", "area"];

/// `{'type': 'sphere', 'radius': 2}` as the call that makes the same, if it is known what that is.
pub fn typed(text: &str) -> Option<String> {
    let inside = text.trim().strip_prefix('{')?.strip_suffix('}')?;
    let fields: Vec<(&str, &str)> = parts(inside).into_iter().filter_map(field).collect();
    let of = |name: &str| fields.iter().find(|(key, _)| *key == name).map(|(_, value)| *value);
    let kind = unquoted(of("type")?);
    match kind {
        "rgb" | "spectrum" | "ref" | "uniform" => Some(value(of("value")?)),
        "bitmap" => Some(format!("texture({})", value(of("filename")?))),
        "perspective" | "thinlens" => {
            let fov = of("fov").map(|fov| format!("fov: {fov}deg")).unwrap_or_default();
            Some(format!("camera({fov})"))
        }
        "scene" => None,
        _ => made(kind, &fields.iter().filter(|(key, _)| *key != "type").copied().collect::<Vec<_>>()),
    }
}

/// A thing of the kind that a constructor makes, of fields by their names elsewhere.
fn made(kind: &str, fields: &[(&str, &str)]) -> Option<String> {
    let rest = |not: &[&str], renamed: &dyn Fn(&str) -> Option<&'static str>| {
        let kept = fields.iter().filter(|(key, _)| !not.contains(key));
        let shown = kept.map(|(key, given)| format!("{}: {}", renamed(key).unwrap_or(key), value(given)));
        shown.collect::<Vec<String>>().join(", ")
    };
    let as_is = |_: &str| None;
    let found = |names: &[&'static str]| {
        let plain = kind.strip_prefix("rough").unwrap_or(kind);
        names.iter().copied().find(|name| *name == plain)
    };
    let kind = match kind {
        "directionalemitter" | "distant" => "directional",
        "envmap" => "environment",
        kind => kind,
    };
    if let Some(mesh) = found(&MESHES).or((kind == "obj" || kind == "ply").then_some("load")) {
        return Some(format!("shape({})", shape_fields(mesh, fields)));
    }
    if let Some(material) = found(&MATERIALS) {
        let renamed = |key: &str| match key {
            "int_ior" | "eta" => Some("ior"),
            "alpha" => Some("roughness"),
            _ => None,
        };
        return Some(format!("{material}({})", rest(&["material", "distribution", "id", "ext_ior"], &renamed)));
    }
    let light = found(&LIGHTS).or_else(|| LIGHTS.into_iter().find(|light| *light == kind))?;
    Some(format!("{light}({})", rest(&["to_world", "id"], &as_is)))
}

/// The fields of a shape whose mesh a function makes: what belongs to the mesh, where it stands, its material.
fn shape_fields(mesh: &str, fields: &[(&str, &str)]) -> String {
    let (mut of_mesh, mut moved, mut own) = (Vec::new(), String::new(), Vec::new());
    for (key, given) in fields {
        match *key {
            "bsdf" | "material" => own.push(format!("material: {}", value(given))),
            "center" | "position" | "location" => moved = format!(" |> translate({})", value(given)),
            "filename" => of_mesh.push(value(given)),
            "to_world" | "emitter" | "id" => {}
            _ if given.trim_start().starts_with('{') => own.push(format!("material: {}", value(given))),
            key => of_mesh.push(format!("{key}: {}", value(given))),
        }
    }
    own.insert(0, format!("mesh: {mesh}({}){moved}", of_mesh.join(", ")));
    own.join(", ")
}

/// Whether a function of this name makes a material.
pub fn makes_material(function: &str) -> bool {
    MATERIALS.contains(&function)
}

/// `sphere s { radius: 2, material: diffuse() }`, `point l { position: p }`, `diffuse m { … }`: the declaration of the thing that a constructor
/// makes.
pub fn constructed(word: &str, behind: &str) -> Option<String> {
    let name = leading_word(behind);
    let inside = behind.get(name.len()..)?.trim().strip_prefix('{')?.strip_suffix('}')?;
    let fields: Option<Vec<(&str, &str)>> = parts(inside).into_iter().map(field).collect();
    let (fields, listed) = (fields.filter(|_| !name.is_empty() && !inside.contains('\n'))?, inside.trim());
    if MESHES.contains(&word) {
        return Some(format!("shape {name} {{ {} }}", shape_fields(word, &fields)));
    }
    let kind = match word {
        _ if MATERIALS.contains(&word) => "material",
        _ if LIGHTS.contains(&word) && !listed.is_empty() => "light",
        _ => return None,
    };
    Some(format!("{kind} {name} = {word}({listed})"))
}

/// `'radius': 2`
fn field(part: &str) -> Option<(&str, &str)> {
    let (key, value) = part.split_once(':')?;
    Some((unquoted(key), value.trim()))
}

fn unquoted(text: &str) -> &str {
    text.trim().trim_matches(['"', '\''])
}

/// A value as it is written here: dictionaries as calls, texts in double quotes.
fn value(text: &str) -> String {
    let text = text.trim();
    match text.chars().next() {
        Some('{') => typed(text).unwrap_or_else(|| "…".to_owned()),
        Some('\'') => format!("\"{}\"", unquoted(text)),
        _ => text.to_owned(),
    }
}

/// What to type for a section of TOML, `[camera]` and lines with `=`, or of YAML, `camera:` and indented lines; and which of both it is.
pub fn section(text: &str) -> Option<(&'static str, String)> {
    let text = text.trim_start();
    let head = text.lines().next()?.trim_end();
    let (language, name, sign) = if text.starts_with('{') {
        ("JSON", text.split('"').nth(1)?, ':')
    } else if let Some(name) = head.strip_prefix('[').and_then(|name| name.strip_suffix(']')) {
        ("TOML", name.trim_matches(['[', ']']), '=')
    } else if let Some(name) = head.strip_suffix(':').filter(|name| leading_word(name) == *name && !is_block(name)) {
        ("YAML", name, ':')
    } else if head.starts_with("- ") {
        ("YAML", "", ':')
    } else {
        return None;
    };
    let words = || name.split(['.', '"', ' ']).filter(|word| !word.is_empty());
    let kind = words().map(|word| word.trim_end_matches('s')).find(|word| KINDS.contains(word)).unwrap_or("camera");
    let own = words().next_back().filter(|word| word.trim_end_matches('s') != kind).unwrap_or("NAME");
    let entries = text.lines().skip(1).filter_map(|line| {
        let (key, value) = line.trim().trim_start_matches("- ").split_once(sign)?;
        let (key, value) = (unquoted(key), value.trim());
        let is_angle = key == "fov" && value.parse::<f64>().is_ok();
        let is_name = leading_word(key) == key && !key.is_empty() && !value.is_empty();
        is_name.then(|| format!("{key}: {value}{}", if is_angle { "deg" } else { "" }))
    });
    let mut fields = entries.collect::<Vec<String>>().join(", ");
    if fields.is_empty() || fields.len() > 80 || language == "JSON" {
        "…".clone_into(&mut fields);
    }
    let typed = if kind == "material" {
        format!("material {own} = diffuse({fields})")
    } else {
        format!("{kind} {own} {{ {fields} }}")
    };
    Some((language, format!("scenes of {language} are not read; what is in them is declared: `{typed}`")))
}
