//! What a page is told of a program: its params and its camera.

use std::sync::Arc;

use serde_json::{Value as Json, json};

use super::hub::Pose;
use super::view::{item_of, viewpoints};
use crate::check::Reached;
use crate::check::hir::Program;
use crate::check::types::Ty;
use crate::cli::script::{as_script, numbers};
use crate::diag::Diagnostic;
use crate::eval::{self, Engine, ParamInfo, ParamKind, is_angle};
use crate::natives::transform_matrix;
use crate::natives::value::{CameraValue, Value};
use crate::session::show::{self, significant};
use crate::syntax;
use crate::syntax::ast::{KindBody, StatementKind};
use crate::tape::Tensor;

/// Params with more numbers are shown in brief and cannot be set.
pub const SET_BY_HAND: usize = 24;

/// All params: values with angles in degrees, bounds (null where a side is open), and whether they are colours.
pub fn params(engine: &mut Engine) -> Result<Json, Diagnostic> {
    let infos = engine.params()?;
    let reached = engine.domains();
    let mut all = Vec::with_capacity(infos.len());
    for info in infos {
        let value = engine.param_value(info.id)?;
        let ty = engine.program().decl(info.id).ty.clone();
        let unit = |t: &Tensor| -> Vec<f64> {
            t.data.iter().map(|x| if is_angle(&ty) { x.to_degrees() } else { *x }).collect()
        };
        let is_small = value.len() <= SET_BY_HAND && info.kind != ParamKind::Rotation;
        let reached = reached.get(&info.id).map_or(&[][..], Vec::as_slice);
        let bounds = is_small.then(|| bounds(&info, reached, &value)).map(|(low, high)| (unit(&low), unit(&high)));
        all.push(json!({
            "name": info.name,
            "type": ty.to_string(),
            "shape": info.shape,
            "angle": is_angle(&ty),
            "frozen": info.frozen,
            "elements": if info.kind == ParamKind::Rotation { 3 } else { value.len() },
            "values": is_small.then(|| unit(&value)),
            "low": bounds.as_ref().map(|(low, _)| low),
            "high": bounds.as_ref().map(|(_, high)| high),
            "unset": (!is_small).then(|| why_unset(&info, value.len())),
            "color": is_small && is_color(&info, reached),
            "text": crate::session::run::shortened(&show::with_unit(&value, &ty)),
        }));
    }
    Ok(Json::Array(all))
}

/// Between what each number may be set: its bounds, and within them what the input takes that it goes to: what is a reflectance lies within
/// 0..1 although the script does not say so. Infinite where a side is open.
fn bounds(info: &ParamInfo, reached: &[Reached], value: &Tensor) -> (Tensor, Tensor) {
    let free = |end: f64| Tensor { shape: value.shape.clone(), data: vec![end; value.len()] };
    let (mut low, mut high) = info.bounds.clone().unwrap_or_else(|| (free(f64::NEG_INFINITY), free(f64::INFINITY)));
    for reached in reached {
        // What lies outside as it is (and is told where it is used) must be able to stay where it is.
        let inside = |at: usize| reached.part.contains(&value.shape, at);
        if (0..value.len()).any(|at| inside(at) && !reached.contains(value.data[at])) {
            continue;
        }
        for at in (0..value.len()).filter(|at| inside(*at)) {
            let (least, most) = reached.limits(value.data[at]);
            low.data[at] = low.data[at].max(least);
            high.data[at] = high.data[at].min(most);
        }
    }
    (low, high)
}

/// Why a param has no sliders.
fn why_unset(info: &ParamInfo, numbers: usize) -> String {
    match info.kind {
        ParamKind::Rotation => "A rotation has no sliders: set it in the script.".to_owned(),
        _ => format!("{numbers} numbers have no sliders, up to {SET_BY_HAND} would: set them in the script."),
    }
}

/// The language has colours as vectors of three numbers: they are told from others by what they are for.
fn is_color(info: &ParamInfo, reached: &[Reached]) -> bool {
    const WORDS: [&str; 9] =
        ["color", "colour", "albedo", "reflectance", "radiance", "specular", "diffuse", "tint", "emission"];
    let speaks = |text: &str| WORDS.iter().any(|word| text.to_lowercase().contains(word));
    info.shape == [3]
        && (speaks(&info.name) || reached.iter().any(|r| r.part.is_whole() && r.line.is_same() && speaks(&r.argument)))
}

/// The cameras of the script, where the chosen one is, and the line that puts it there.
pub fn camera(engine: &mut Engine, name: &str, camera: &Arc<CameraValue>, moved: Option<Pose>) -> Json {
    let program = engine.program();
    let names = viewpoints(program);
    let own = pose_of(camera);
    let pose = moved.or(own);
    let (width, height) = camera.image_size().unwrap_or((256, 256));
    // Both keyframes of a moving camera would have to move.
    let movable = camera.closing.is_none() && own.is_some();
    let line = |pose: Pose| match item_of(name) {
        // A camera of a list has no statement of its own, but an expression in it.
        Some(_) => elsewhere(camera, &rounded(pose), None),
        None => line(program, name, camera, &pose),
    };
    json!({
        "names": names,
        "name": name,
        "film": [width, height],
        "movable": movable,
        "moved": moved.is_some(),
        "pose": pose.map(|Pose { position, look_at, up }| json!({"position": position, "look_at": look_at, "up": up})),
        "line": pose.filter(|_| movable).map(line),
    })
}

/// Where a camera is. One that is placed by a transform looks at the point of its axis that is nearest to the origin.
fn pose_of(camera: &CameraValue) -> Option<Pose> {
    let numbers = |name: &str, or: [f64; 3]| match camera.field(name) {
        Some(value) => <[f64; 3]>::try_from(value.var()?.value().data.as_slice()).ok(),
        None => Some(or),
    };
    let Some(transform) = camera.field("transform") else {
        let (position, look_at) = (numbers("position", [0.0, 0.0, 5.0])?, numbers("look_at", [0.0; 3])?);
        return Some(Pose { position, look_at, up: numbers("up", [0.0, 1.0, 0.0])? });
    };
    let matrix = transform_matrix(transform)?;
    let data = &matrix.value().data;
    let column = |i: usize| Some(glam::DVec3::new(*data.get(i)?, *data.get(4 + i)?, *data.get(8 + i)?));
    let (up, forward, position) = (column(1)?.normalize(), column(2)?.normalize(), column(3)?);
    let distance = -position.dot(forward);
    let distance = if distance > 1e-3 { distance } else { 1.0 };
    let pose = [position, position + distance * forward, up].map(|v| v.to_array());
    Some(Pose { position: pose[0], look_at: pose[1], up: pose[2] })
}

/// Five digits of its numbers: more than a hand places a camera by.
fn rounded(pose: Pose) -> Pose {
    let rounded = |v: [f64; 3]| v.map(|x| significant(x, 5).parse().unwrap_or(x));
    Pose { position: rounded(pose.position), look_at: rounded(pose.look_at), up: rounded(pose.up) }
}

/// An expression for a camera made of what this one is made of that stands elsewhere, and perhaps has another film.
pub fn elsewhere(camera: &CameraValue, pose: &Pose, film: Option<[usize; 2]>) -> String {
    // Whole numbers without a point.
    let plain = |shape: &[usize], data: &[f64]| {
        let text = numbers(shape, data).replace(".0,", ",").replace(".0]", "]");
        text.strip_suffix(".0").map(str::to_owned).unwrap_or(text)
    };
    let Pose { position, look_at, up } = pose;
    let mut arguments: Vec<String> =
        [("position", position), ("look_at", look_at)].map(|(field, v)| format!("{field}: {}", plain(&[3], v))).into();
    if *up != [0.0, 1.0, 0.0] {
        arguments.push(format!("up: {}", plain(&[3], up)));
    }
    arguments.extend(film.map(|film| format!("film: {film:?}")));
    let kept = |field: &str| !is_place(field) && (film.is_none() || field != "film");
    arguments.extend(camera.fields.iter().filter(|(field, _)| kept(field)).map(|(field, value)| match value {
        Value::Num(v) if field.starts_with("fov") => format!("{field}: {}", as_script(v.value(), &Ty::Angle)),
        Value::Num(v) => format!("{field}: {}", plain(v.shape(), &v.value().data)),
        Value::Str(text) => format!("{field}: \"{text}\""),
        other => format!("{field}: {}", eval::show(other, &Ty::Any)),
    }));
    format!("camera({})", arguments.join(", "))
}

/// Whether a field of a camera says where it is.
fn is_place(field: &str) -> bool {
    ["position", "look_at", "up", "transform"].contains(&field)
}

/// The camera's statement, with the fields that place it.
fn line(program: &Program, name: &str, camera: &CameraValue, pose: &Pose) -> String {
    let vector = |v: &[f64; 3]| format!("[{}]", v.map(|x| significant(x, 5)).join(", "));
    let mut places = vec![("position", vector(&pose.position)), ("look_at", vector(&pose.look_at))];
    if camera.field("up").is_some() && pose.up != [0.0, 1.0, 0.0] || camera.field("transform").is_some() {
        places.push(("up", vector(&pose.up)));
    }
    let decl = program.find(name).map(|id| program.decl(id));
    let statements = decl.map(|d| syntax::parse(&program.sources, d.span.source).0.statements).unwrap_or_default();
    let statement = statements.iter().find(|s| s.declares() == Some(name));
    if let Some(statement) = statement
        && let StatementKind::Kind { body: KindBody::Fields(fields), .. } = &statement.kind
        && let Some(first) = fields.first()
    {
        let mut text = program.sources.text(statement.span).to_owned();
        let start = statement.span.start;
        let mut edits: Vec<(u32, u32, String)> = Vec::new();
        let mut missing = String::new();
        for (field, value) in &places {
            match fields.iter().find(|f| f.name.text == *field) {
                Some(known) => edits.push((known.value.span.start, known.value.span.end, value.clone())),
                None => missing.push_str(&format!("{field}: {value}, ")),
            }
        }
        match fields.iter().find(|f| f.name.text == "transform") {
            Some(known) => {
                let all = missing.trim_end_matches(", ").to_owned();
                edits.push((known.name.span.start, known.value.span.end, all));
            }
            None => edits.push((first.name.span.start, first.name.span.start, missing)),
        }
        edits.sort_by_key(|edit| std::cmp::Reverse(edit.0));
        for (from, to, new) in edits {
            let range = (from - start) as usize..(to - start) as usize;
            if text.get(range.clone()).is_some() {
                text.replace_range(range, &new);
            }
        }
        return text;
    }
    // A camera that some call made: what it is made of is written out.
    let others = camera.fields.iter().filter(|(field, _)| !is_place(field)).map(|(field, value)| match value {
        Value::Num(v) if field.starts_with("fov") => {
            format!("{field}: {}deg", significant(v.item().unwrap_or_default().to_degrees(), 6))
        }
        Value::Str(text) => format!("{field}: {text}"),
        other => format!("{field}: {}", eval::show(other, &Ty::Any)),
    });
    let fields: Vec<String> = places.iter().map(|(field, value)| format!("{field}: {value}")).chain(others).collect();
    format!("camera {name} {{ {} }}", fields.join(", "))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::check::{self, Disk};
    use crate::eval::EngineOptions;

    fn engine(text: &str) -> Engine {
        let checked = check::check_text("t.dscene", None, text, &[], &Disk);
        Engine::new(checked.program.unwrap_or_else(|| panic!("{:?}", checked.diagnostics)), EngineOptions::default())
    }

    fn told(text: &str, moved: Option<Pose>) -> Json {
        let mut engine = engine(text);
        let id = engine.program().find("eye").unwrap();
        let Value::Camera(value) = engine.eval_decl(id).unwrap() else { panic!("no camera") };
        camera(&mut engine, "eye", &value, moved)
    }

    /// The line that a page gives is a camera that stands where the page's did.
    #[test]
    fn the_line_puts_the_camera_where_it_was_moved() {
        let moved = Pose { position: [1.0, 2.0, 3.0], look_at: [0.0, 0.5, 0.0], up: [0.0, 1.0, 0.0] };
        for (before, expected) in [
            (
                "let w = 8\ncamera eye {\n  position: [0, 0, -4] // far\n  look_at: [0, 0, 0]\n  film: [w, w]\n}",
                "camera eye {\n  position: [1, 2, 3] // far\n  look_at: [0, 0.5, 0]\n  film: [w, w]\n}",
            ),
            (
                "camera eye { position: [0, 0, -4], film: [8, 8] }",
                "camera eye { look_at: [0, 0.5, 0], position: [1, 2, 3], film: [8, 8] }",
            ),
            (
                "camera eye { fov: 30deg, transform: translation([0, 0, -4]), film: [8, 8] }",
                "camera eye { fov: 30deg, position: [1, 2, 3], look_at: [0, 0.5, 0], up: [0, 1, 0], film: [8, 8] }",
            ),
            (
                "fn far() = camera(position: [0, 0, 9], fov: 30deg, film: [8, 8], kind: \"fisheye\")\ncamera eye = far()",
                "",
            ),
        ] {
            let found = told(before, Some(moved));
            let line = found["line"].as_str().unwrap();
            assert!(expected.is_empty() || line == expected, "{line}");
            let again = told(&format!("let w = 8\n{line}"), None);
            assert_eq!(again["pose"], found["pose"], "{line}");
            assert_eq!(again["film"], json!([8, 8]), "{line}");
            assert!(!line.contains("transform"), "{line}");
        }
    }

    /// What is told of an item of a list is an expression that may stand in its place.
    #[test]
    fn cameras_of_lists_are_turned_with_all_that_they_are_made_of() {
        let moved = Pose { position: [1.0, 2.0, 1.0 / 3.0], look_at: [0.0, 0.5, 0.0], up: [0.0, 1.0, 0.0] };
        for (item, expected) in [
            ("camera(film: [8, 4])", "camera(position: [1, 2, 0.33333], look_at: [0, 0.5, 0], film: [8, 4], "),
            ("camera(transform: translation([0, 0, -4]), fov: 30deg, film: [8, 4])", ""),
            (
                "camera(kind: \"fisheye\", distortion: [0.1, 0.02], film: [8, 4], filter: \"tent\", crop: [0, 0, 4, 4])",
                "",
            ),
            (
                "camera(position: [0, 0, 9], film: [8, 4], focal: [9, 8], principal: [4, 2], aperture: 0.1, focus: 3)",
                "",
            ),
        ] {
            let found = |text: &str, moved: Option<Pose>| {
                let mut engine = engine(text);
                let id = engine.program().find("eyes").unwrap();
                let Value::Camera(value) = engine.eval_decl(id).unwrap().items().unwrap().swap_remove(0) else {
                    panic!("{text}")
                };
                let told = camera(&mut engine, "eyes[0]", &value, moved);
                // All that is not its place.
                let is_of_place = |name: &str| ["position", "look_at", "up", "transform"].contains(&name);
                let others = value.fields.iter().filter(|(name, _)| !is_of_place(name));
                let others: BTreeMap<String, serde_json::Value> =
                    others.map(|(name, value)| (name.clone(), eval::to_json(value))).collect();
                (told, others)
            };
            let (told, others) = found(&format!("let eyes = [{item}]"), Some(moved));
            let line = told["line"].as_str().unwrap();
            assert!(line.starts_with(expected), "{line}");
            let (again, others_again) = found(&format!("let eyes = [{line}]"), None);
            assert_eq!(others_again, others, "{line}");
            assert_eq!(again["pose"]["position"], json!([1.0, 2.0, 0.33333]), "{line}");
            assert_eq!(
                (&again["pose"]["look_at"], &again["film"]),
                (&told["pose"]["look_at"], &told["film"]),
                "{line}"
            );
        }
    }

    #[test]
    fn cameras_by_transform_look_along_z() {
        let found = told("camera eye { transform: translation([0, 1, -4]), film: [8, 8] }", None);
        let pose = json!({"position": [0.0, 1.0, -4.0], "look_at": [0.0, 1.0, 0.0], "up": [0.0, 1.0, 0.0]});
        assert_eq!((&found["pose"], &found["movable"]), (&pose, &json!(true)));
    }

    /// Nothing that a slider offers is refused.
    #[test]
    fn sliders_end_where_bounds_and_inputs_do() {
        let mut engine = engine(
            "param grey = 0.5 in 0..\nparam power = [1, 2, 3]\nparam bright = 0.5 in ..0.8\nparam free = 7 in 1..\n\
             let m = diffuse(reflectance: [grey, bright, 0])\nlet n = diffuse(reflectance: grey)\nlet o = diffuse(reflectance: bright)\n\
             light sky = constant(radiance: power)",
        );
        let all = params(&mut engine).unwrap();
        let bounds = |at: usize| json!([all[at]["low"], all[at]["high"]]);
        assert_eq!(bounds(0), json!([[0.0], [1.0]]));
        assert_eq!(bounds(1), json!([[0.0, 0.0, 0.0], [null, null, null]]));
        assert_eq!(bounds(2), json!([[0.0], [0.8]]));
        assert_eq!(bounds(3), json!([[1.0], [null]]));
    }

    #[test]
    fn cameras_in_lists_are_looked_through() {
        let told = |text: &str| {
            let mut engine = engine(text);
            viewpoints(engine.program())
                .into_iter()
                .map(|name| {
                    let mut view = crate::cli::live::view::View::new(4);
                    view.of(engine.program());
                    view.choose(name.clone());
                    let Ok((chosen, value)) = view.camera(&mut engine) else { panic!("{name}") };
                    let told = camera(&mut engine, &chosen, &value, None);
                    json!([told["name"], told["film"], told["movable"]])
                })
                .collect::<Json>()
        };
        let list = "let eyes = [camera(position: [0, 0, k + 3], film: [4, 2 + k]) for k in 0..3]";
        let item = |k: usize| json!([format!("eyes[{k}]"), [4, 2 + k], true]);
        assert_eq!(told(list), json!([item(0), item(1), item(2)]));
        assert_eq!(told("let eye = camera(film: [4, 2])"), json!([["eye", [4, 2], true]]));
        // Where a camera is declared as one, it is what the script wants to be looked through.
        assert_eq!(told(&format!("{list}\ncamera front {{ film: [8, 8] }}")), json!([["front", [8, 8], true]]));
        assert_eq!(told("let n = 1"), json!([]));
    }

    #[test]
    fn params_say_how_they_may_be_set() {
        let mut engine = engine(
            "param turn = 30deg in 0deg..90deg\nparam paint = [0.1, 0.2, 0.3]\nparam many = [0.5 for i in 0..100]\n\
             param stays = 2 { frozen: true }\nlet m = diffuse(reflectance: paint)",
        );
        let all = params(&mut engine).unwrap();
        let near = |x: &Json, y: f64| (x.as_f64().unwrap() - y).abs() < 1e-9;
        assert!(near(&all[0]["values"][0], 30.0) && near(&all[0]["high"][0], 90.0) && all[0]["angle"] == true);
        assert_eq!(
            (&all[1]["color"], &all[1]["low"], &all[1]["high"]),
            (&json!(true), &json!([0.0, 0.0, 0.0]), &json!([1.0, 1.0, 1.0]))
        );
        assert_eq!((&all[2]["values"], &all[2]["elements"]), (&Json::Null, &json!(100)));
        assert_eq!((&all[2]["low"], &all[0]["unset"]), (&Json::Null, &Json::Null));
        assert!(all[2]["unset"].as_str().unwrap().starts_with("100 numbers have no sliders"), "{all}");
        let open = json!([null]);
        assert_eq!((&all[3]["frozen"], &all[3]["low"], &all[3]["color"]), (&json!(true), &open, &json!(false)));
    }
}
