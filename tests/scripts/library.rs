//! The standard library: every example evaluates, and what the checker says of a value's type is true of the value.

use dscene::check::types::Ty;
use dscene::check::{Disk, Line, check_line, check_text};
use dscene::diag::{RenderOptions, render, render_all};
use dscene::eval::{Engine, EngineOptions, on_large_stack};
use dscene::natives::fields_of;

use crate::place::{Place, assert_code};
use crate::typed::disagreement;

/// What the examples may use.
const FIXTURE: &str = "
import std.studio as studio
import std.cornell as cornell
import std.presets as presets
import std.photo as photo
camera eye { position: [0, 0, 5], fov: 45deg, film: [16, 16] }
param size = 1
param turn = 10deg
param pose: rotation = rotation(angle: 20deg)
param tint: color = 0.5
shape ball { mesh: icosphere(radius: size, subdivisions: 1), material: diffuse(reflectance: tint) }
light sky = constant(1)
light lamp = area(rectangle() |> flip() |> translate([0, 4, 0]), radiance: 5)
let img = render(eye, spp: 1)
loss fit = mse(render(eye, spp: 1), img + 0.1)
fn ring(n: int, r: scalar = 1) {
  let part = 360deg / n
  [[r * cos(part * i), 0, r * sin(part * i)] for i in 0..n]
}
";

/// Expressions whose sizes are inferred in ways of their own.
const SIZES: &[&str] = &[
    "ring(5)",
    "[[1, 2], [3, 4]][0]",
    "[1, 2, 3, 4][1..-1]",
    "[1, 2, 3][..=1]",
    "[[1, 2, 3], [4, 5, 6]].xy",
    "[[1, 2, 3], [4, 5, 6]] + [1, 1, 1]",
    "[[1], [2]] * [[1, 2, 3]]",
    "(0..7)",
    "[i for i in 0..4 if i > 1]",
    "[a * b for a in [1, 2] for b in 0..=2]",
    "crop(img, x: 1, y: 2, width: 5, height: 3)",
    "resize(img, width: 5, height: 3)",
    "downsample(img)",
    "downsample(img, factor: 3)",
    "downsample(crop(img, width: 7, height: 5), factor: 2)",
    "gradient(img)",
    "luminance(img)",
    "luminance([0.1, 0.2, 0.3])",
    "pyramid(img, levels: 2)",
    "montage([img, 2 * img, img, img, img])",
    "montage([img, 2 * img], columns: 1, gap: 2)",
    "colormap(luminance(img))",
    "pixels(eye)",
    "pixels(eye).x + img",
    "img.rg",
    "img * [1, 0.5, 0]",
    "max(img, 0.5)",
    "max([1, 2, 3])",
    "image([[0, 1], [1, 0]])",
    "transpose([[1, 2, 3], [4, 5, 6]])",
    "reshape([1, 2, 3, 4, 5, 6], [3, 2])",
    "compose(rotation(), rotation())",
    "transpose(rotation())",
    "transpose(translation([1, 2, 3]))",
    "inverse(rotation())",
    "inverse(translation([1, 2, 3]))",
    "inverse([[2, 1], [1, 1]])",
    "determinant(translation([1, 2, 3]))",
    "[[1, 2, 3], [4, 5, 6]] @ [1, 2, 3]",
    "[1, 2] @ [[1, 2, 3], [4, 5, 6]]",
    "[1, 2] @ [3, 4]",
    "[[1, 2, 3], [4, 5, 6]] @ [[1, 2], [3, 4], [5, 6]]",
    "pose @ [1, 0, 0]",
    "pose @ ball.mesh.vertices",
    "pose @ normal(eye)",
    "pose @ pose",
    "pose @ translation([1, 2, 3])",
    "translation([1, 2, 3]) @ cube()",
    "matrix(pose) @ img",
    "[[1, 2, 3]] @ img",
    "sum([[1, 2, 3], [4, 5, 6]], axis: 0)",
    "mean([[1, 2, 3], [4, 5, 6]], axis: -1)",
    "max(img, axis: 2)",
    "mean(img, axis: [0, 1])",
    "sum(img, axis: 0)",
    "min([[1, 2, 3], [4, 5, 6]], axis: [0, 1])",
    "norm([[3, 4], [0, 0]], axis: 1)",
    "median(stack([img, 2 * img, img + 1]), axis: 0)",
    "percentile(img, 99, axis: 2)",
    "std([[1, 2, 3], [4, 5, 6]], axis: 0)",
    "sort([[3, 1], [2, 5]])",
    "sort(img)",
    "argmax(img)",
    "argmax(img, axis: 2)",
    "argmin([[1, 5], [3, 2]], axis: 0)",
    "argmin([3, 1, 2])",
    "where(img > 0.5, 1, 0)",
    "where([1, 2, 3] > 2, [4, 5, 6], 0)",
    "where(2 > 1, 30deg, 40deg)",
    "where(luminance(img) > 0.5, [1, 0, 0], img)",
    "where(2 > 1, [1, 2, 3], 0)",
    "img > 0.5",
    "[1, 2, 3] >= [3, 2, 1]",
    "not (img > 0.5)",
    "img > 0.5 and img < 0.9",
    "mod([5, -1, 7], 3)",
    "mod(-30deg, 360deg)",
    "concat(img, img)",
    "concat(img, luminance(img), axis: 2)",
    "concat(img, crop(img, width: 2, height: 16), axis: 1)",
    "concat([img, img, img], axis: -2)",
    "concat([[1, 2], [3, 4]], [[5], [6]], axis: 1)",
    "concat([[1, 2], [3, 4], [5, 6]])",
    "stack([img, img])",
    "stack([[1, 2], [3, 4]])",
    "pad(img, left: 2, top: 3, value: [1, 0, 0])",
    "pad(img, right: 20, bottom: 40, mode: mirror)",
    "sample(img, [0.5, 0.5])",
    "sample(img, [[0.5, 0.5], [0.1, 0.9]])",
    "sample(luminance(img), uv(eye), wrap: repeat)",
    "img[1, 2]",
    "img[1]",
    "img[-1, 2, 0]",
    "[[1, 2, 3], [4, 5, 6]][1, 0..2]",
    "[[1, 2, 3], [4, 5, 6]][1, ..2]",
    "[[1, 2, 3], [4, 5, 6]][0, 1..]",
    "to_srgb(img)",
    "from_srgb(tint)",
    "project(eye, [0, 1, 0])",
    "project(eye, ball.mesh.vertices)",
    "project(eye, position(eye))",
    "bounds(ball.mesh)",
    "chamfer(ball.mesh, [[0, 0, 0], [1, 1, 1]])",
    "rotation(six: [1, 0, 0, 1, 1, 0])",
    "noise(4)",
    "noise([2, 3])",
    "concat([[1, 2, 3]], [[4, 5, 6], [7, 8, 9]])",
    "zip([1, 2], [[1, 2], [3, 4]])",
    "matrix(rotation())",
    "matrix(translation([1, 2, 3]))",
    "ball.mesh.vertices",
    "img.width",
    "grad(fit, tint)",
    "grad(fit, turn)",
    "jvp(render(eye, spp: 1), size)",
    "jacobian(render(eye, spp: 1), size)",
    "jacobian(render(eye, spp: 1), tint)",
    "jacobian(ball.mesh.vertices, [size, turn])[1]",
    "fd(fit, size)",
    "render(eye, spp: 1) with { tint: 0.2 }",
    "render(eye, spp: 1) with { eye: camera(film: [8, 4]) }",
    "if size > 0 then [1, 2] else [3, 4]",
    "turn / 1deg",
    "atan2(1, 2)",
    "euler(x: 20deg)",
    "point(position: [1, 2, 3]).position",
    "eye.fov",
    "eye.film",
    "eye.position",
    "lamp.radiance",
    "concat([1, 2], 0..3)",
    "mix([0, 0, 0], [1, 2, 4], 0.5)",
    "x => x + 1",
    "[eye, eye]",
    "[1, \"a\"]",
    "estimate(fit, repeats: 2)",
    "grad(fit)",
    // Beside what is not known before it runs.
    "[\"a\", \"a\", mean(lamp.radiance)]",
    "[1, sky.radiance]",
    "[[1, 2], [3, sky.radiance]]",
    "[[1, 2], [lamp.radiance, 3]][1]",
    "if size > 2 then \"a\" else lamp.radiance",
    "[if i > 0 then \"a\" else lamp.radiance for i in 0..2]",
    "concat([\"a\"], [lamp.radiance])",
    "concat(texture(img).texels, ball.material.reflectance + img)",
    "zip([\"a\", \"b\"], [1, lamp.radiance])",
    "zip([\"a\", \"b\"], [1, lamp.radiance])[0][floor(sum([0.5]))]",
    "[\"a\", lamp.radiance, 1][..2]",
    "where(size > 0, lamp.radiance, \"a\")",
    "[f(1) for f in [x => lamp.radiance, x => \"a\"]]",
    "[(if size > 2 then (x => lamp.radiance) else (x => \"a\"))(1)]",
    "if size > 2 then [] else [\"a\"]",
    // Of numbers all the same.
    "[lamp.radiance, 1, 2].x + [lamp.radiance, 0][0]",
    "-[lamp.radiance, 1] * [2, 3] + lamp.radiance",
    "lamp.radiance + [lamp.radiance, 1]",
    "[lamp.radiance, 1] == [5, 1]",
    "[lamp.radiance, 1, 1] * img",
    "all([lamp.radiance, 1] > 0)",
    "not ([lamp.radiance, 1] > 0)",
    "([lamp.radiance, 1, 1] > 0) and [1, 0, 1]",
    "lamp.radiance > 0 and size > 0",
    "[lamp.radiance, 2] * 1deg",
    "[lamp.radiance, lamp.radiance] @ [3, 4]",
    "pose @ [lamp.radiance, 0, 0]",
    "if size > 2 then [lamp.radiance, 0] else [1, 2]",
    "sum([[lamp.radiance, 1], [1, 2]])",
    "sqrt([[lamp.radiance, 1], [1, 2]])",
    "diffuse(reflectance: [lamp.radiance / 10, 0, 0])",
    "cube() |> translate([lamp.radiance, 0, 0])",
    "[[lamp.radiance, 1], [1, 2]][0..1][0].x",
];

fn engine() -> Engine {
    let checked = check_text("fixture.dscene", None, FIXTURE, &[], &Disk);
    let shown = render_all(&checked.diagnostics, &checked.sources, RenderOptions::plain());
    let Some(program) = checked.program else { panic!("{shown}") };
    Engine::new(program, EngineOptions { base_dir: ".".into(), ..Default::default() })
}

/// Checks and evaluates; what is wrong, if anything is.
fn faults(engine: &mut Engine, text: &str) -> Option<String> {
    let mut program = engine.program().clone();
    let (line, diagnostics) = check_line(&mut program, text);
    let Some(Line::Expr(e)) = line else {
        return Some(format!("{text}: {}", render_all(&diagnostics, &program.sources, RenderOptions::plain())));
    };
    match engine.eval(&e) {
        Err(d) => Some(format!("{text}: {}", render(&d, &program.sources, RenderOptions::plain()))),
        Ok(value) => disagreement(&e.ty, &value).map(|why| format!("{text}: `{}` but {why}", e.ty)),
    }
}

#[test]
fn every_example_of_the_library_evaluates_to_what_its_type_says() {
    on_large_stack(|| {
        let mut engine = engine();
        // Where the example is the name alone, a call needs a file.
        let examples: Vec<String> = engine
            .program()
            .decls
            .iter()
            .filter(|d| !d.user)
            .filter_map(|d| {
                d.doc.split_once("Example: ").map(|(_, example)| example.to_owned()).filter(|e| *e != d.name)
            })
            .collect();
        assert!(examples.len() > 90, "{}", examples.len());
        let wrong: Vec<String> = examples.iter().filter_map(|e| faults(&mut engine, e)).collect();
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    });
}

#[test]
fn inferred_sizes_are_the_real_ones() {
    on_large_stack(|| {
        let mut engine = engine();
        let wrong: Vec<String> = SIZES.iter().filter_map(|e| faults(&mut engine, e)).collect();
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    });
}

/// The checker knows the inputs of every material that the library has an example of.
#[test]
fn inputs_of_materials_check() {
    on_large_stack(|| {
        let mut engine = engine();
        let mut program = engine.program().clone();
        let examples: Vec<String> = program
            .decls
            .iter()
            .filter(|d| !d.user)
            .filter_map(|d| d.doc.split_once("Example: ").map(|(_, example)| example.to_owned()))
            .collect();
        let mut inputs = 0;
        for example in examples {
            let Some(Line::Expr(e)) = check_line(&mut program, &example).0 else { continue };
            if e.ty != Ty::Material {
                continue;
            }
            let Ok(material) = engine.eval(&e) else { panic!("{example}") };
            for input in fields_of(&material) {
                inputs += 1;
                assert_eq!(faults(&mut engine, &format!("({example}).{input}")), None);
            }
        }
        assert!(inputs > 12, "{inputs}");
    });
}

/// Whatever field of a thing the checker lets through is there, with the type that it says.
#[test]
fn fields_that_check_are_there() {
    let things = "eye; sky; lamp; ball; img; [1, 2, 3]; diffuse(); mirror(); conductor(reflectance: 1); conductor(eta: 1, k: 2); \
        phong(); plastic(); cloth(); dielectric(); dielectric(absorption: 1); dielectric(roughness: 0.3); thin_dielectric(); thin_dielectric(roughness: 0.3); principled(); mask(diffuse(), 0.5); normal_map(plastic(), [0.5, 0.5, 1]); brushed(plastic()); sheened(plastic(), sheen: 0.5); coated(conductor(), coat: 0.5); blend(diffuse(), cloth()); one_sided(mask(mirror(), 0.5)); point(position: [0, 0, 0]); point(position: [0, 0, 0], profile: img); \
        spot(position: [0, 1, 0], direction: [0, -1, 0]); directional(direction: [0, -1, 0]); environment([1, 1, 1]); constant(1); \
        area(disk(), material: diffuse()); camera(); camera(fov_x: 40deg, focus: 2, distortion: [0.1]); camera(filter: \"tent\", crop: [1, 2, 3, 4]); texture([[1]]); checkerboard(); \
        scene(shapes: [ball], lights: [sky]); estimate(fit, repeats: 2); estimate(img, repeats: 2)";
    // Of meshes not: which of theirs there are depends on the file or function that made them.
    let fields = "x y z w r g b a xy bgr width height channels texels position look_at up fov fov_x film kind transform aperture focus \
        distortion shutter mesh material radiance two_sided intensity direction irradiance cutoff beam image profile rotation scale \
        reflectance roughness ior eta k diffuse specular sheen absorption base_color metallic sheen_roughness coat coat_roughness weight opacity normals source filter wrap srgb tiles shapes lights mean \
        std_error vertices faces";
    on_large_stack(|| {
        let mut engine = engine();
        let mut there = 0;
        let mut wrong = Vec::new();
        for thing in things.split("; ") {
            for field in fields.split_whitespace() {
                let text = format!("{thing}.{field}");
                let mut program = engine.program().clone();
                if !matches!(check_line(&mut program, &text), (Some(Line::Expr(_)), _)) {
                    continue;
                }
                there += 1;
                wrong.extend(faults(&mut engine, &text));
            }
        }
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
        assert!(there > 100, "{there}");
    });
}

/// Calibrated cameras: points come to lie where the pinhole model of OpenCV and COLMAP says.
#[test]
fn calibrated_cameras_project_as_their_matrix_says() {
    let place = crate::place::Place::new();
    let scene = |film: &str, focal: &str, principal: &str| {
        format!(
            "let m = matrix(translation([0.1, -0.2, 4]) @ euler(x: 195deg, y: 20deg, z: 8deg))
            let eye = camera(film: {film}, transform: opencv_pose(m), focal: {focal}, principal: {principal})
            fn pixel(p: vec3) {{
              let q = m @ [p.x, p.y, p.z, 1]
              [(70 * q.x / q.z + 30) / 64, (66 * q.y / q.z + 27) / 48]
            }}
            let points = [[0, 0, 0], [0.7, -0.3, 0.4], [-0.9, 0.5, -0.6]]
            expect [project(eye, p) for p in points] ≈ [pixel(p) for p in points] within 1e-5
            let flipped = inverse(m) @ [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]
            let same = camera(film: {film}, transform: opengl_pose(flipped), focal: {focal}, principal: {principal})
            expect project(same, points) ≈ project(eye, points) within 1e-6\n"
        )
    };
    place.run(&scene("[64, 48]", "[70, 66]", "[30, 27]"));
    // The same camera with twice the pixels, and by the width of its sensor.
    place.run(&scene("[128, 96]", "[140, 132]", "[60, 54]"));
    place.run(&scene("[64, 48]", "[35, 33]", "[30, 27]").replace("principal", "sensor_width: 32, principal"));
}

/// A stage's smaller film shows what the whole one does.
#[test]
fn a_scaled_film_keeps_the_calibration() {
    let place = crate::place::Place::new();
    let shown = place.run(
        "param x = 0.3
        camera eye { position: [0, 0, 4], look_at: [0, 0, 0], film: [32, 24], focal: 40, principal: [10, 15], crop: [3, 2, 20, 17] }
        loss off = sum((project(eye, [x, 0.2, 0]) - project(eye, [0.1, 0.2, 0])) ^ 2) + 0 * mean(render(eye, spp: 1))
        shape ball { mesh: sphere() }
        light sky = constant(1)
        let scale = project(eye, [1, 0, 0]).x - project(eye, [0, 0, 0]).x
        optimize off { using: sgd(lr: 0), stage half { steps: 2, film_scale: 0.5 }, every 1 { print \"scale {scale:.5}\" } }
        print \"scale {scale:.5}\"",
    );
    let scales: Vec<&str> = shown.lines().filter(|line| line.contains("scale 0")).collect();
    assert!(scales.len() >= 2 && scales.iter().all(|line| line.contains("0.3125")), "{shown}");
}

/// What is written in the language has its values tested in the language.
#[test]
fn functions_of_the_library_give_what_is_known_otherwise() {
    let place = Place::new();
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scripts/library.dscene");
    let output = place.dsl(&["test", &file.display().to_string()]);
    assert_code(&output, 0);
}
