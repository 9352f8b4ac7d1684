//! Where derivatives end: at edges of operations, of the renderer's own, of domains; and values that are not numbers.

#[path = "common/place.rs"]
mod place;

use place::{Place, assert_code, stderr, stdout};

/// A camera and a light for scenes whose material is of interest.
const SCENE: &str = "camera eye { position: [0, 0, 5], film: [8, 8] }\nlight sky = constant(1)\n";

#[test]
fn second_derivatives_of_what_renders_nothing() {
    let place = Place::new();
    place.write(
        "second.dscene",
        r"param q = 2
param v = [1, 2]
let f = q ^ 3
camera eye { position: [q ^ 2, 0, 5] }
let product = q ^ 2 * exp(v[0])
let bowl = v[0] ^ 2 * v[1]
expect abs(grad(grad(f, q), q) - 12) < 1e-9
expect abs(grad(grad(grad(f, q), q), q) - 6) < 1e-9
expect abs(jvp(grad(f, q), q) - 12) < 1e-9
expect abs(grad(jvp(f, q), q) - 12) < 1e-9
expect abs(jvp(jvp(f, q, direction: q), q) - (12 * 2 + 12)) < 1e-9
expect abs(fd(grad(f, q), q, step: 1e-4) - 12) < 1e-6
expect abs(grad(sum(grad(sum(eye.position ^ 3), eye.position)), q) - 96) < 1e-9
expect norm(grad(grad(product, q), v) - [4 * exp(1), 0]) < 1e-9
expect norm(jacobian(grad(bowl, v), v) - [[4, 2], [2, 0]]) < 1e-9
expect norm(grad(sum(jacobian(v * q ^ 2, q)), q) - 6) < 1e-9
loss z = (grad(f, q) - 3) ^ 2
optimize z { over: [q], using: adam(lr: 0.05), steps: 400 }
expect abs(q - 1) < 1e-3
",
    );
    let out = place.dsl(&["run", "second.dscene", "--out", "o"]);
    assert_code(&out, 0);
}

#[test]
fn second_derivatives_of_meshes_and_filters() {
    let place = Place::new();
    place.write(
        "second.dscene",
        r"param q = 0.5
let turned = smooth_normals(sphere(subdivisions: 8) |> translate([q, 0, 0]) |> scale([1, q, 1]))
let bend = sum(turned.normals ^ 4)
let blurred = mean(blur(image([[q, 0, 1], [1, q ^ 2, 0]]), 1) ^ 2)
expect abs(grad(grad(bend, q), q) / fd(grad(bend, q), q, step: 1e-4) - 1) < 1e-5
expect abs(grad(grad(blurred, q), q) / fd(grad(blurred, q), q, step: 1e-4) - 1) < 1e-5
",
    );
    let out = place.dsl(&["run", "second.dscene", "--out", "o"]);
    assert_code(&out, 0);
}

#[test]
fn second_derivatives_of_what_renders_are_refused() {
    let scene = format!("{SCENE}param r = 0.5\nshape ball {{ mesh: sphere(), material: diffuse(r) }}\n");
    let scene = format!("{scene}let bright = mean(render(eye, spp: 1))\n");
    for (what, name) in [
        ("print grad(grad(bright, r), r)", "`render`"),
        ("print jvp(grad(bright, r), r)", "`render`"),
        ("print grad(mean(jvp(render(eye, spp: 1), r)), r)", "`render`"),
        ("print grad(fd(bright, r), r)", "`fd`"),
        ("print grad(estimate(bright, repeats: 2).mean, r)", "`estimate`"),
        ("optimize (grad(bright, r) - 1) ^ 2 { steps: 2 }", "`render`"),
    ] {
        let place = Place::new();
        place.write("second.dscene", format!("{scene}{what}\n"));
        let out = place.dsl(&["run", "second.dscene", "--out", "o"]);
        assert_code(&out, 1);
        let said = stderr(&out);
        assert!(said.contains(&format!("{name} has first derivatives only")) && said.contains("fd(grad("), "{said}");
    }
    // Values of derivatives, and derivatives of constants, are as good as ever.
    let place = Place::new();
    place.write(
        "fine.dscene",
        format!(
            "{scene}print fd(grad(bright, r), r)\nprint grad(r * stop_gradient(grad(bright, r)), r)\noptimize bright - stop_gradient(grad(bright, r)) {{ steps: 2 }}\n"
        ),
    );
    assert_code(&place.dsl(&["run", "fine.dscene", "--out", "o"]), 0);
}

#[test]
fn gamma_of_a_black_background_optimises() {
    let place = Place::new();
    place.write(
        "gamma.dscene",
        format!(
            "{SCENE}param r = 0.3\nshape ball {{ mesh: sphere(), material: diffuse(r) }}\n\
             light lamp = point([0, 3, 4], intensity: 20)\n\
             let dark = scene(shapes: [ball], lights: [lamp])\n\
             let target = gamma(render(eye, dark, spp: 4) with {{ r: 0.7 }})\n\
             loss fit = mse(gamma(render(eye, dark, spp: 4)), target)\n\
             optimize fit {{ using: adam(lr: 0.05), steps: 60 }}\nexpect abs(r - 0.7) < 0.05\n"
        ),
    );
    let out = place.dsl(&["run", "gamma.dscene", "--out", "o"]);
    assert_code(&out, 0);
    assert!(!stderr(&out).contains("skipped"), "{}", stderr(&out));
    assert!(!stdout(&out).contains("nan"), "{}", stdout(&out));
}
