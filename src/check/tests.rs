//! The checker on programs that are right; wrong ones are in `tests/diagnostics.rs`.

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
