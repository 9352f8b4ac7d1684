//! The checker on programs that are right; wrong ones are in `tests/scripts/diagnostics.rs`.

use super::hir::{Action, DeclKind, ExprKind};
use super::*;
use crate::diag::{RenderOptions, render_all};

const SHADOW: &str = r#"
/// Recover an occluder from nothing but its shadow.

camera eye {
  position: [0, 2, -5]
  look_at:  [0, 0, 0]
  fov:      45deg
  film:     [256, 256]
}

material grey = diffuse(reflectance: 0.5)

param corners: vec3[4] = [[-0.2, 3.5, -0.8], [-0.8, 3.0, 0.3], [0.4, 2.8, -0.8], [0.3, 3.2, 1.0]]

shape ground  { mesh: rectangle(width: 4, depth: 4), material: grey }
shape blocker { mesh: mesh(vertices: corners, faces: [[0, 1, 2], [1, 3, 2]]), material: grey }
light lamp = area(rectangle(width: 0.2, depth: 0.2) |> flip() |> translate([0, 5, 0]), radiance: 1000)

let truth  = [[-0.5, 3, -0.5], [-0.5, 3, 0.5], [0.5, 3, -0.5], [0.5, 3, 0.5]]
let target = render(eye, spp: 256) with { corners: truth }

loss shadow = mse(render(eye, spp: 4), target)

optimize shadow {
  using: adam(lr: 0.01)
  steps: 200
}

save render(eye, spp: 256) to "final.exr"
expect psnr(render(eye, spp: 256), target) > 35
"#;

fn program(text: &str) -> hir::Program {
    let checked = check_text("test.dscene", None, text, &[], &Disk);
    let shown = render_all(&checked.diagnostics, &checked.sources, RenderOptions::plain());
    assert!(checked.diagnostics.is_empty(), "{shown}");
    checked.program.expect("a program without errors")
}

/// The params that reach a declaration.
fn reaching_params_of(program: &hir::Program, decl: hir::DeclId) -> Vec<hir::DeclId> {
    let reaching = |body: &Arc<hir::Expr>| flow::Reaching::params(program).of(body).iter().map(hir::DeclId).collect();
    program.decl(decl).body.as_ref().map_or_else(Vec::new, reaching)
}

fn ty(program: &hir::Program, name: &str) -> String {
    program.decl(program.find(name).expect("declared")).ty.to_string()
}

#[test]
fn the_shadow_script_is_checked() {
    let program = program(SHADOW);
    assert_eq!(program.actions.len(), 3);
    assert_eq!(program.default_scene.len(), 3);
    assert_eq!(ty(&program, "corners"), "vec3[4]");
    assert_eq!(ty(&program, "target"), "image 256×256");
    assert_eq!(ty(&program, "shadow"), "scalar");
    let loss = program.find("shadow").expect("declared");
    let names = |ids: Vec<hir::DeclId>| ids.iter().map(|id| program.decl(*id).name.clone()).collect::<Vec<_>>();
    assert_eq!(names(reaching_params_of(&program, loss)), ["corners"]);
    // The target has its corners replaced.
    assert!(reaching_params_of(&program, program.find("target").expect("declared")).is_empty());
    let Some(Action::Optimize(optimize)) = program.actions.first() else { panic!("no optimize") };
    assert!(matches!(optimize.loss.kind, ExprKind::Decl(id) if id == loss));
}

#[test]
fn an_empty_program_has_the_library() {
    for text in ["", "\n\n", "// nothing\n/* here */"] {
        let program = program(text);
        assert!(program.find("render").is_some() && program.actions.is_empty());
    }
}

/// What the examples of the library may use.
const FIXTURE: &str = "
import std.studio as studio
import std.cornell as cornell
import std.presets as presets
import std.photo as photo
camera eye { position: [0, 0, 5], fov: 45deg, film: [32, 32] }
param size = 1
shape ball { mesh: sphere(radius: size) }
light sky = constant(1)
let img = render(eye)
loss fit = mse(render(eye), img + 0.1)
";

#[test]
fn every_library_declaration_has_a_docstring_and_an_example_that_checks() {
    let mut fixture = program(FIXTURE);
    let library: Vec<(String, String)> = fixture
        .decls
        .iter()
        .filter(|d| !d.user && !is_private(&d.name))
        .map(|d| (d.name.clone(), d.doc.clone()))
        .collect();
    assert!(library.len() > 100);
    let mut wrong = Vec::new();
    for (name, doc) in library {
        let Some((text, example)) = doc.split_once("Example: ") else {
            wrong.push(format!("{name}: no example"));
            continue;
        };
        if text.trim().is_empty() {
            wrong.push(format!("{name}: no docstring"));
        }
        if !example.contains(name.as_str()) && name != "zip" && name != "constant_rate" {
            wrong.push(format!("{name}: the example does not use it"));
        }
        if example.trim() == name.as_str() {
            continue; // A call needs a file.
        }
        let (line, diagnostics) = check_line(&mut fixture, example);
        if !matches!(line, Some(Line::Expr(_))) || !diagnostics.is_empty() {
            wrong.push(render_all(&diagnostics, &fixture.sources, RenderOptions::plain()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_syntax_of_sections_three_to_seven_is_checked() {
    let program = program(
        r##"
import std.studio as studio
/* a comment /* nested */ */
let small = [0.1, 0.2, 30%]
let warm: color = #ff8800
let grey: color = 0.5
let dims = [64, 64]
let turn = 0.25turn + 45deg
let ratio = turn / 1deg
let picked = small[-1] + small[0..2][1] + small.x
let many = [i * j + 0.5 for i in 0..4 for j in 0..=2 if i != j]
let pairs = [a * b for a, b in zip(small, [1, 2, 3])]
let square = x => x ^ 2
let both = (x, y) => square(x) + y
let chosen = if 1 < 2 and not false then both(1, 2) else 0
fn area_of(r: scalar, k = 2) : scalar = pi * r ^ k
fn ring(n: int, r: scalar = 1) {
  let step_angle = 360deg / n
  [[r * cos(step_angle * i), 0, r * sin(step_angle * i)] for i in 0..n]
}
let points = ring(8)
let text = "a {area_of(2):.3} {{b}} {"x{1 + 1}"}"

param albedo: color = 0.5 in 0..1 { lr: 0.5, scale: 2, frozen: false }
param pose: rotation = rotation(axis: [0, 1, 0], angle: 30deg)
param spin: angle = 10deg in -90deg..90deg
param offset = [0, 0, 0]
param texels: vec3[4] = [[0, 0, 0], [1, 1, 1], [0, 0, 0], [1, 1, 1]] in [0, 0, 0]..[1, 1, 1]

camera front { position: [0, 1, -4], fov: 40deg, film: dims, kind: perspective }
camera top = camera(position: [0, 4, 0], up: [0, 0, 1], kind: "orthographic", film: dims, height: 3)
let views = [front, top]
mesh body = teapot(subdivisions: 2) |> rotate(y: spin) |> rotate(by: pose) |> translate(offset)
texture paint = texture(reshape(texels, [2, 2, 3]), filter: nearest)
material glaze = principled(base_color: albedo, roughness: 0.3)
shape pot { mesh: body, material: glaze }
shape floor { mesh: rectangle(width: 8, depth: 8), material: diffuse(reflectance: paint) }
light lamp = area(rectangle() |> flip() |> translate([0, 5, 0]), radiance: 20)
scene night { shapes: [pot], lights: [lamp, constant(0.1)] }
scene lit = scene(shapes: [pot, floor], lights: studio.three_point(power: 10))
integrator fast { max_bounces: 2 }

let photos = [render(v) with { offset: [0.1, 0, 0], spin: 0deg, pose: rotation(), albedo: 0.2 } for v in views]
let brighter = render(front, scene: night) with { lamp.radiance: 40 }
loss fit = mean([mse(render(v), t) for v, t in zip(views, photos)]) + 1e-3 * norm(offset) + 0 * sum(texels)
loss shape_only = pyramid_loss(alpha(front), alpha(front) with { offset: [1, 0, 0] }, levels: 3, loss: l1)

optimize fit {
  over:  [offset, albedo, lamp.radiance]
  using: adam(lr: cosine(0.02, 0.001))
  steps: 200

  stage coarse { steps: 100, film_scale: 1/4, using: adam(lr: 0.05) }
  stage fine   { steps: 200, spp: 16 }

  stop_when: loss < 1e-5 or step > 190
  correlated: false
  every 10 { save render(front, spp: 64) to "frames/{step:04}.png" print loss_value }
}
let loss_value = fit
print fit, grad(fit, offset), "done: {estimate(fit, repeats: 4)}"
plot fit to "fit.png"
save jvp(render(front), lamp.radiance) to "d.exr"
expect fd(fit, spin, step: 0.01) < 1 and grad(fit, spin) < 1 and pixels(front).x.width == 64
"##,
    );
    for (name, wanted) in [
        ("small", "vec3"),
        ("warm", "vec3"),
        ("grey", "vec3"),
        ("turn", "angle"),
        ("ratio", "scalar"),
        ("pairs", "vec3"),
        ("points", "vec3[8]"),
        ("photos", "image 64×64[2]"),
        ("lit", "scene"),
        ("albedo", "vec3"),
        ("pose", "rotation"),
    ] {
        assert_eq!(ty(&program, name), wanted, "{name}");
    }
    let albedo = program.decl(program.find("albedo").expect("declared"));
    assert!(matches!(&albedo.kind, DeclKind::Param(p) if p.bounds.is_some() && p.lr.is_some()));
    let fit = program.find("fit").expect("declared");
    assert_eq!(reaching_params_of(&program, fit).len(), 5);
}

#[test]
fn lines_add_replace_and_ask() {
    let mut program = program(SHADOW);
    let corners = program.find("corners").expect("declared");
    let (line, diagnostics) = check_line(&mut program, "shadow * 2");
    assert!(diagnostics.is_empty());
    assert!(matches!(line, Some(Line::Expr(e)) if e.ty.is_scalar()));
    let (line, _) = check_line(&mut program, "param corners: vec3[4] = [[0, 3, 0], [1, 3, 0], [0, 3, 1], [1, 3, 1]]");
    assert!(matches!(line, Some(Line::Statements { declared, .. }) if declared == [corners]));
    assert_eq!(program.find("corners"), Some(corners));
    let (line, _) = check_line(&mut program, "let half = shadow / 2");
    assert!(matches!(line, Some(Line::Statements { declared, .. }) if declared.len() == 1));
    let (line, _) = check_line(&mut program, "half + shadow");
    assert!(matches!(line, Some(Line::Expr(_))));
    let (line, _) = check_line(&mut program, "save render(eye) to \"a.png\"");
    assert!(matches!(line, Some(Line::Statements { actions, .. }) if matches!(actions[..], [Action::Save { .. }])));
    assert_eq!(program.actions.len(), 3);
    let (line, diagnostics) = check_line(&mut program, "grad(shadow)");
    assert!(matches!(line, Some(Line::Expr(_))), "{diagnostics:?}");
    let (line, diagnostics) = check_line(&mut program, "let half = shado");
    assert!(line.is_none());
    assert_eq!(diagnostics.first().map(|d| d.code), Some("dscene::name::unknown"));
    assert!(matches!(check_line(&mut program, "  // nothing").0, Some(Line::Empty)));
    assert!(check_line(&mut program, "1 +").0.is_none());
}

#[test]
fn overrides_replace_values() {
    let set = |name: &str, value: &str| vec![(name.to_owned(), value.to_owned())];
    let checked = check_text("t", None, SHADOW, &set("corners", "[[0, 3, 0], [1, 3, 0], [0, 3, 1], [1, 3, 2]]"), &Disk);
    assert!(checked.program.is_some());
    let checked = check_text("t", None, SHADOW, &set("eye", "camera(fov: 45deg, film: [64, 64])"), &Disk);
    let program = checked.program.expect("fine");
    assert_eq!(ty(&program, "target"), "image 64×64");
    let checked = check_text("t", None, SHADOW, &set("corner", "1"), &Disk);
    assert_eq!(
        checked.diagnostics.first().and_then(|d| d.helps.first()).map(String::as_str),
        Some("did you mean `corners`?")
    );
    let checked = check_text("t", None, SHADOW, &set("corners", "1 +"), &Disk);
    assert!(checked.program.is_none() && !checked.diagnostics.is_empty());
}

#[test]
fn imports_bring_names_files_and_errors_of_their_own() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a parent")).expect("created");
        std::fs::write(&path, text).expect("written");
        path
    };
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    write("lib/a.obj", obj);
    write(
        "lib/studio.dscene",
        "import \"more.dscene\"\nlet height = base + 1\nfn wall(z) = load(\"a.obj\") |> translate([0, 0, z])\nshape back { mesh: wall(3) }\n",
    );
    write("lib/more.dscene", "import \"../main.dscene\" as main\nlet base = main.offset\n");
    let main = write(
        "main.dscene",
        "import \"lib/studio.dscene\" as studio\nlet offset = 2\nlet h = studio.height + 1\nlet w = studio.wall(1)\nlet b = studio.back.mesh\n",
    );
    let checked = check(&main, &[], &Disk);
    let shown = render_all(&checked.diagnostics, &checked.sources, RenderOptions::plain());
    let program = checked.program.unwrap_or_else(|| panic!("{shown}"));
    assert_eq!(ty(&program, "h"), "scalar");
    assert_eq!(program.default_scene.len(), 1, "shapes of imported files are in the scene");
    let wall = program.decl(program.find("wall").expect("declared"));
    let DeclKind::Fn(f) = &wall.kind else { panic!("a function") };
    let mut paths = Vec::new();
    flow::walk(&f.body, &mut |e| {
        if let ExprKind::Str(parts) = &e.kind
            && let Some(hir::StrPart::Text(path)) = parts.first()
        {
            paths.push(path.clone());
        }
    });
    assert!(paths.iter().any(|p| Path::new(p).is_absolute() && p.ends_with("a.obj")), "{paths:?}");

    write("lib/more.dscene", "let base = nowhere\n");
    let checked = check(&main, &[], &Disk);
    let names: Vec<&str> =
        checked.diagnostics.iter().filter_map(|d| d.span()).map(|s| checked.sources.name(s.source)).collect();
    assert!(names.len() == 1 && names[0].ends_with("more.dscene"), "{names:?}");
    assert!(check(&folder.path().join("none.dscene"), &[], &Disk).program.is_none());
    let binary = folder.path().join("binary.dscene");
    std::fs::write(&binary, [0xff, 0xfe, 0x00]).expect("written");
    assert_eq!(check(&binary, &[], &Disk).diagnostics.first().map(|d| d.code), Some("dscene::file::unreadable"));
}

#[test]
fn a_value_does_not_hide_the_function_of_its_name() {
    let program = program(
        "camera camera { film: [8, 8] }\nshape floor { mesh: rectangle() }\nlet depth = depth(camera)\n\
         param scale = 2\nlet big = cube() |> scale(floor(scale))\nlet mix = (a, b) => a + b\nlet c = mix(1, 2)\n\
         loss length = mean(render(camera) with { scale: 2 }) * scale + length([scale, 1])\n",
    );
    assert_eq!(ty(&program, "depth"), "image 8×8 with 1 channel");
    assert_eq!(ty(&program, "c"), "scalar", "the function value of the script is called");
}
