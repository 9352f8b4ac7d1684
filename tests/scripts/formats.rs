//! Scenes and shaders of other formats: each script is one mistake, however many statements it has, told with a text to type that then checks.

use dscene::check::{Disk, check_text};

/// A script, the text under the label, the text to type, and what that becomes when its gaps are filled.
const ROWS: &[[&str; 4]] = &[
    // Mitsuba.
    [
        "<scene version=\"3.0.0\">",
        "<scene",
        "shape NAME { mesh: sphere(), material: diffuse() }",
        "shape s { mesh: sphere(), material: diffuse() }",
    ],
    [
        "<?xml version=\"1.0\"?>\n<scene version=\"3.0.0\">\n  <integrator type=\"path\"/>\n  <shape type=\"sphere\">\n    \
         <float name=\"radius\" value=\"2\"/>\n  </shape>\n</scene>",
        "<?xml",
        "integrator NAME { max_bounces: 8 }",
        "integrator i { max_bounces: 8 }",
    ],
    [
        "<shape type=\"sphere\">\n  <float name=\"radius\" value=\"2\"/>\n  <bsdf type=\"diffuse\"/>\n</shape>",
        "<shape",
        "shape NAME { mesh: sphere(radius: 2), material: diffuse() }",
        "shape s { mesh: sphere(radius: 2), material: diffuse() }",
    ],
    [
        "<bsdf type=\"diffuse\"><rgb name=\"reflectance\" value=\"0.2 0.25 0.7\"/></bsdf>",
        "<bsdf",
        "material NAME = diffuse([0.2, 0.25, 0.7])",
        "material m = diffuse([0.2, 0.25, 0.7])",
    ],
    [
        "<sensor type=\"perspective\"><float name=\"fov\" value=\"40\"/></sensor>",
        "<sensor",
        "camera NAME { fov: 40deg }",
        "camera k { fov: 40deg }",
    ],
    ["<emitter type=\"constant\"/>", "<emitter", "light NAME = constant(1)", "light l = constant(1)"],
    ["<default name=\"spp\" value=\"16\"/>", "<default", "let spp = 16", "let spp = 16"],
    ["<!-- far\n let a = -->", "<!", "// far", "// far"],
    // PBRT.
    [
        "Shape \"sphere\" \"float radius\" 2",
        "Shape",
        "shape NAME { mesh: sphere(radius: 2), material: diffuse() }",
        "shape s { mesh: sphere(radius: 2), material: diffuse() }",
    ],
    [
        "LookAt 0 0 5  0 1 0  0 1 0\nCamera \"perspective\" \"float fov\" [45]\nWorldBegin\nAttributeBegin\n\
         Material \"matte\" \"rgb Kd\" [0.5 0.5 0.5]\nTranslate 0 1 0\nShape \"sphere\"\n  \"float radius\" [1]\nAttributeEnd\nWorldEnd",
        "LookAt",
        "camera NAME { position: [0, 0, 5], look_at: [0, 1, 0] }",
        "camera k { position: [0, 0, 5], look_at: [0, 1, 0] }",
    ],
    ["Camera \"perspective\" \"float fov\" [40]", "Camera", "camera NAME { fov: 40deg }", "camera k { fov: 40deg }"],
    [
        "Film \"rgb\" \"integer xresolution\" [64] \"integer yresolution\" [48]",
        "Film",
        "camera NAME { film: [64, 48] }",
        "camera k { film: [64, 48] }",
    ],
    [
        "Material \"matte\" \"color Kd\" [0.5 0.5 0.25]",
        "Material",
        "material NAME = diffuse([0.5, 0.5, 0.25])",
        "material m = diffuse([0.5, 0.5, 0.25])",
    ],
    [
        "MakeNamedMaterial \"glass\" \"string type\" \"dielectric\"",
        "MakeNamedMaterial",
        "material NAME = dielectric()",
        "material m = dielectric()",
    ],
    [
        "LightSource \"infinite\" \"rgb L\" [1 2 1]",
        "LightSource",
        "light NAME = constant([1, 2, 1])",
        "light l = constant([1, 2, 1])",
    ],
    [
        "AreaLightSource \"diffuse\" \"rgb L\" [1 1 2]",
        "AreaLightSource",
        "light NAME = area(…, radiance: [1, 1, 2])",
        "light l = area(cube(), radiance: [1, 1, 2])",
    ],
    ["Translate 0 1 0", "Translate", "let NAME = translate(…, [0, 1, 0])", "let m = translate(cube(), [0, 1, 0])"],
    [
        "Rotate 45 0 1 0",
        "Rotate",
        "let NAME = rotate(…, axis: [0, 1, 0], angle: 45deg)",
        "let m = rotate(cube(), axis: [0, 1, 0], angle: 45deg)",
    ],
    ["Scale 1 2 1", "Scale", "let NAME = scale(…, [1, 2, 1])", "let m = scale(cube(), [1, 2, 1])"],
    ["let a = 1\nWorldBegin\nlet b = a", "WorldBegin", "", "let a = 1\nlet b = a"],
    // OBJ.
    ["v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1", "v", "mesh NAME = load(\"….obj\")", ""],
    // GLSL.
    ["#version 330", "#", "", ""],
    ["#define N 3", "#", "let N = 3", "let N = 3"],
    ["vec3 a = vec3(1.0);", "vec3", "let a = vec3(1.0)", ""],
    ["uniform float x;", "uniform", "param x = 0", "param x = 0"],
    ["uniform vec3 p = vec3(1, 2, 3);\nuniform float x;\nout vec4 color;", "uniform", "param p = vec3(1, 2, 3)", ""],
    [
        "float twice(float x, float y) { return x * 2.0 + y; }",
        "float",
        "fn twice(x, y) = x * 2.0 + y",
        "fn twice(x, y) = x * 2.0 + y",
    ],
    [
        "uniform float time;\nprecision highp float;\nvoid main() {\n  gl_FragColor = vec4(1.0);\n}",
        "uniform",
        "param time = 0",
        "param time = 0",
    ],
    // Python and JavaScript.
    ["let f = fn(x) = x * 2", "fn", "x => x * 2", "let f = x => x * 2"],
    ["let f = fn(x, y) => x * y", "fn", "(x, y) => x * y", "let f = (x, y) => x * y"],
    ["let f = function(x) { return x * 2; }", "function", "x => x * 2", "let f = x => x * 2"],
    ["let f = def(x): x * 2", "def", "x => x * 2", "let f = x => x * 2"],
    ["from std.studio import floor", "from", "import std.studio as studio", "import std.studio as studio"],
    ["from shapes import ball, box", "from", "import \"shapes.dscene\"", ""],
    ["from \"shapes.dscene\" import ball", "from", "import \"shapes.dscene\"", ""],
    ["from numpy import sin", "from", "", ""],
    ["x: float = 1", ":", "let x = 1", "let x = 1"],
];

#[test]
fn each_foreign_script_is_one_mistake() {
    let mut failures = Vec::new();
    for [wrong, blamed, typed, mended] in ROWS {
        let checked = check_text("script.dscene", None, format!("{wrong}\n"), &[], &Disk);
        let found: Vec<_> = checked.diagnostics.iter().filter(|d| d.is_error()).collect();
        let shown: Vec<String> = found.iter().map(|d| format!("    {}: {:?}", d.message, d.helps)).collect();
        let [one] = found[..] else {
            failures.push(format!("{wrong:?} gives {} errors\n{}", found.len(), shown.join("\n")));
            continue;
        };
        let at = one.span().map_or("", |span| checked.sources.text(span));
        let helps = one.helps.iter().any(|help| help.contains(&format!("`{typed}`")) || typed.is_empty());
        if at != *blamed || !helps {
            failures.push(format!("{wrong:?} blames {at:?}\n{}", shown.join("\n")));
        }
        let again = check_text("script.dscene", None, format!("{mended}\n"), &[], &Disk);
        if again.diagnostics.iter().any(|d| d.is_error()) {
            failures.push(format!("{mended:?} is still wrong: {:?}", again.diagnostics));
        }
    }
    assert!(failures.is_empty(), "{} failures\n{}", failures.len(), failures.join("\n"));
}

/// What looks like a tag or a directive may be a comparison or a name.
#[test]
fn names_and_comparisons_are_no_other_language() {
    for script in [
        "let y = 3\nlet x = 2\nlet a = x\n  <y and y > x",
        "let Shape = 3\nlet Camera = Shape\n  + 1\nprint Camera",
        "let from = 2\nlet a = from\nimport std.studio as studio",
        "let f = x => x\nfn g(x) = f(x)",
        "let uniform_x = 2\nlet void = 3\nprint void",
    ] {
        let checked = check_text("script.dscene", None, script, &[], &Disk);
        assert!(!checked.diagnostics.iter().any(|d| d.is_error()), "{script}: {:#?}", checked.diagnostics);
    }
}
