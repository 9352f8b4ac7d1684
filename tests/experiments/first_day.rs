//! What someone who does inverse rendering would write on the first day: each script runs and finds what it looks for.

use std::fs;

use crate::place::{Place, assert_code, assert_diagnosed, stderr, stdout};

const EYE: &str = "camera eye { position: [0, 0, -5], look_at: [0, 0, 0], fov: 45deg, film: [16, 16] }\n";

#[test]
fn views_from_all_sides_in_small_batches() {
    let place = Place::new();
    place.write(
        "rig.dscene",
        "/// Cameras on a circle.\n\
         fn view(i: int, n: int = 4) = camera(position: [4 * sin(i / n * 360deg), 2, 4 * cos(i / n * 360deg)],\n\
           look_at: [0, 0, 0], fov: 40deg, film: [16, 16])\n\
         fn lamp_at(p: vec3, power = 10) = area(disk(radius: 0.5) |> flip() |> translate(p), radiance: power)\n",
    );
    let printed = place.run(
        "import \"rig.dscene\"\nimport \"rig.dscene\" as rig
         param size: vec3 = [0.8, 1, 1.2] in 0.1..3
         let views = [view(i) for i in 0..4]
         shape box { mesh: cube() |> scale(size) |> rotate(y: 20deg), material: diffuse(reflectance: 0.5) }
         light top = rig.lamp_at([0, 3, 0])
         light sky = constant(0.3)
         let photos = [render(v, spp: 64) for v in views] with { size: [1, 1, 1] }
         loss fit = mean([mse(render(v, spp: 4), p) for v, p in minibatch(zip(views, photos), 2)])
         loss all = mean([mse(render(v, spp: 16), p) for v, p in zip(views, photos)])
         print \"before {all:.2e}\"
         optimize fit {
           using: adam(lr: cosine(0.05, 0.005)), steps: 30
           every 10 { print \"step {step}\"  save render(views[0]) to \"view_{step:02}.png\"  plot size.x }
         }
         expect all < 1e-3 and length(size - 1) < 0.2",
    );
    assert!(printed.contains("before ") && printed.contains("step 20"), "{printed}");
    // The curve grows with every plot.
    let last = printed.lines().rfind(|l| l.starts_with("size.x")).unwrap();
    assert_eq!(last.split_whitespace().last().unwrap().chars().count(), 3, "{printed}");
    assert!(place.path("run/view_20.png").is_file());
}

#[test]
fn a_mesh_from_a_file_with_an_unknown_texture() {
    let place = Place::new();
    place.write(
        "quad.obj",
        "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 4/4 3/3 2/2\n",
    );
    place.run(
        "camera eye { position: [0, 3, 0.001], look_at: [0, 0, 0], fov: 45deg, film: [16, 16] }
         param texels: scalar[4][4] = [[0.5 for j in 0..4] for i in 0..4] in 0..1
         shape floor { mesh: load(\"quad.obj\"), material: diffuse(reflectance: texture(texels)) }
         light sky = constant(1)
         let truth = [[if (i + j) / 2 == floor((i + j) / 2) then 0.9 else 0.1 for j in 0..4] for i in 0..4]
         let target = render(eye, spp: 64) with { texels: truth }
         loss fit = l1(render(eye, spp: 4), target) + 0.001 * mean(abs(texels - 0.5))
         optimize fit { using: adam(lr: 0.1), steps: 30 }
         save texels to \"texels.json\"
         save texels to \"texels.png\"
         save texture(texels) to \"texture.exr\"
         expect mean(abs(texels - truth)) < 0.15",
    );
    assert!(place.path("run/texture.exr").is_file());
}

#[test]
fn a_turned_environment() {
    let place = Place::new();
    let script = "param turn: angle = 20deg in -90deg..90deg
         let map = image([[if j < 4 then [3, 2, 1] else [0.1, 0.2, 0.4] for j in 0..16] for i in 0..8])
         light sky = environment(map, rotation: turn)
         shape ball { mesh: sphere(subdivisions: 16), material: principled(base_color: #cc8844, metallic: 1, roughness: 0.3) }
         let target = render(eye, spp: 64) with { turn: 0deg }
         loss fit = mse(render(eye, spp: 8), target)
         optimize fit { using: adam(lr: 0.05), steps: 30, stop_when: plateau(window: 10, tolerance: 1%) or fit < 1e-5 }
         print \"{turn / 1deg:.1}\", turn
         expect abs(turn) < 8deg";
    place.run(&format!("{EYE}{script}"));
}

#[test]
fn stages_schedules_several_losses_and_the_library() {
    let place = Place::new();
    place.run(
        "import std.studio as studio
         camera eye { position: [0, 1, -5], look_at: [0, 0, 0], fov_x: 50deg, film: [24, 16] }
         param pos: vec3 = [0.3, 0.2, 0]
         param tint: color = #888888 in 0..1 { lr: 2 }
         param rough = 0.5 in 0.05..1 { frozen: true }
         material paint = phong(diffuse: tint, specular: 0.2, roughness: rough)
         shape pot { mesh: teapot(subdivisions: 2) |> center() |> scale(0.6) |> translate(pos), material: paint }
         shape ground = studio.floor(y: -1)
         light rig = studio.three_point(size: 2, power: 10)
         let target = render(eye, spp: 64) with { pos: [0, 0, 0], tint: #cc2211 }
         loss outline = pyramid_loss(alpha(eye), alpha(eye) with { pos: [0, 0, 0] }, levels: 3, loss: huber)
         loss colour = huber(render(eye, spp: 4), target, delta: 0.2)
         loss total = colour + 0.01 * outline
         let start = total
         optimize total {
           over: [pos, tint]
           stage coarse { steps: 10, spp: 2, film_scale: 1/2, using: sgd(lr: warmup(0.05, steps: 5), momentum: 0.5) }
           stage fine { steps: 30, spp: 8, using: adam(lr: piecewise([[0, 0.03], [40, 0.002]])) }
         }
         save render(eye, spp: 16) |> tonemap() |> gamma() to \"final.png\"
         expect length(pos) < 0.3 and tint.r > tint.g",
    );
}

/// Noise is a bias of losses that are not quadratic: the mean distance from a noisy image is least for one that is too bright. What
/// earlier steps saw of a pixel makes it less noisy.
#[test]
fn control_variates_take_the_bias_of_noise_away() {
    let place = Place::new();
    let gain = |settings: &str, optimizer: &str, seed: &str| {
        let script = format!(
            "camera eye {{ position: [0, 2, -6], look_at: [0, 0.8, 0], fov: 45deg, film: [28, 28] }}
             integrator paths {{ max_bounces: 2 }}
             param gain = 0.8
             param x = 0.3
             shape floor {{ mesh: rectangle(width: 6, depth: 6), material: diffuse(reflectance: 0.7) }}
             shape ball {{ mesh: sphere(radius: 0.6) |> translate([x, 0.8, 0]), material: diffuse(reflectance: [0.3, 0.6, 0.8]) }}
             light lamp = area(rectangle(width: 1, depth: 1) |> flip() |> translate([0, 4, 0]), radiance: 40 * gain)
             let target = render(eye, spp: 256) with {{ x: 0, gain: 1 }}
             loss off = mean(abs(render(eye, spp: 1) - target))
             optimize off {{ steps: 50, using: {optimizer}{settings} }}
             print gain"
        );
        place.write("script.dscene", script);
        place.dsl(&["run", "script.dscene", "--out", "run", "--force", "--seed", seed])
    };
    // Where one seed ends is noisy itself: the mean of two.
    let bias = |settings: &str| -> f64 {
        let found = |seed: &str| -> f64 {
            let output = gain(settings, "adam(lr: cosine(0.05, 0.002))", seed);
            assert_code(&output, 0);
            stdout(&output).trim().parse().unwrap()
        };
        (["0", "1"].map(found).iter().sum::<f64>() / 2.0 - 1.0).abs()
    };
    let (plain, quiet) = (bias(""), bias(", control_variates: true"));
    println!("{plain} without, {quiet} with");
    assert!(plain > 0.008, "{plain}: there is no bias to take away");
    assert!(quiet < 0.6 * plain, "{quiet} with, {plain} without");

    let output = gain(", control_variates: true", "gauss_newton()", "0");
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("first-order"), "{}", stderr(&output));
}

#[test]
fn pose_gradients_and_meshes_out() {
    let place = Place::new();
    let printed = place.run(
        "camera eye { position: [0, 0, 5] + shift, look_at: shift, fov: 40deg, film: [16, 16] }
         param shift: vec3 = [0.2, 0, 0]
         param spin: rotation = rotation(axis: [0, 1, 0], angle: 10deg)
         mesh body = cube(size: [1, 2, 0.5]) |> rotate(by: spin)
         shape thing { mesh: body, material: diffuse(reflectance: [0.9, 0.3, 0.2]) }
         light lamp = point(position: [2, 3, 4], intensity: 30)
         let target = render(eye, spp: 128) with { shift: [0, 0, 0], spin: rotation() }
         loss fit = mse(blur(render(eye, spp: 16), sigma: 1), blur(target, sigma: 1))
         save jvp(render(eye, spp: 16), shift, direction: [1, 0, 0]) to \"dx.exr\"
         print grad(fit, lamp.intensity), estimate(fit, repeats: 4), len(fd(fit, shift))
         optimize fit { over: [shift, spin, lamp.intensity], using: adam(lr: 0.02), steps: 20 }
         save body to \"body.obj\"
         save thing.mesh to \"body.ply\"
         expect abs(shift.x) < 0.2",
    );
    assert!(printed.contains('±'), "{printed}");
    let obj = fs::read_to_string(place.path("run/body.obj")).unwrap();
    assert!(obj.lines().filter(|l| l.starts_with("f ")).count() == 12, "{obj}");
    // What was saved can be loaded again.
    fs::copy(place.path("run/body.ply"), place.path("body.ply")).unwrap();
    let printed = place.run("print len(load(\"body.ply\").faces)");
    assert_eq!(printed.trim(), "12");
}

#[test]
fn functions_lists_of_shapes_and_scenes_as_values() {
    let place = Place::new();
    let printed = place.run("fn twice(f: (scalar) => scalar, x: scalar) = f(f(x))
         fn tower(n: int) {
           let base = cube(size: 0.4)
           merge([base |> translate([0, 0.5 * i, 0]) for i in 0..n])
         }
         let square = x => x * x
         let add = (a, b) => a + b
         let colors = [#f00, #00ff00, [0.1, 0.2, 1]]
         let centers = [[2 * i - 2, 0, 0] for i in 0..3]
         let balls = [shape(mesh: sphere(radius: 0.8, subdivisions: 12) |> translate(c), material: diffuse(reflectance: k))
                      for c, k in zip(centers, colors)]
         let parts = concat(balls, [shape(mesh: tower(3), material: mirror())])
         scene night { shapes: parts, lights: [constant(0.5)] }
         camera eye { position: [0, 2, -8], look_at: [0, 0, 0], fov: 0.125turn, film: [16, 8] }
         let img = render(eye, scene: night, spp: 8)
         print twice(square, 3), add(1, 2), [square(i) for i in 0..4 if i > 0]
         print \"{img.width}x{img.height} {len(night.shapes)} {if mean(img) > 0.1 then \"bright\" else \"dark\"} {50%}\"
         save resize(img, width: 32, height: 16) to \"large.hdr\"
         expect mean(img.g) > 0 and mean(crop(img, x: 2, y: 2, width: 4, height: 4)) > 0",
    );
    assert_eq!(printed, "81 3 [1, 4, 9]\n16x8 4 bright 0.5\n");
}

#[test]
fn a_photo_at_a_coarse_stage() {
    let place = Place::new();
    let scene = format!(
        "{EYE}param x = 0.5\nlight sky = constant(1)\n\
         shape ball {{ mesh: sphere(subdivisions: 12) |> translate([x, 0, 0]), material: diffuse() }}\n"
    );
    place.run(&format!("{scene}save render(eye, spp: 64) with {{ x: 0 }} to \"photo.exr\""));
    fs::copy(place.path("run/photo.exr"), place.path("photo.exr")).unwrap();
    let fit = |photo: &str| {
        format!(
            "{scene}let photo = load_image(\"photo.exr\")\n\
             loss fit = mse(render(eye, spp: 4), {photo})\n\
             optimize fit {{ using: adam(lr: 0.1 * 0.9 ^ step), stage coarse {{ film_scale: 1/2, steps: 8 }} stage fine {{ steps: 8 }} }}\n\
             expect abs(x) < 0.1\n"
        )
    };
    // A photo keeps its size; the message says how it may follow.
    place.write("script.dscene", fit("photo"));
    let output = place.dsl(&["run", "script.dscene", "--out", "run", "--force"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("resize(photo, width: eye.film.x, height: eye.film.y)"), "{}", stderr(&output));
    place.run(&fit("resize(photo, width: eye.film.x, height: eye.film.y)"));
}

#[test]
fn heights_vertex_colours_and_regularisation() {
    let place = Place::new();
    place.run("camera eye { position: [0, 3, -3], look_at: [0, 0, 0], fov: 45deg, film: [16, 16] }
         param heights: scalar[5][5] = [[0 for j in 0..5] for i in 0..5]
         param hue: vec3[4] = [[0.5, 0.5, 0.5] for i in 0..4] in 0..1
         shape land { mesh: heightfield(heights) |> smooth_normals(), material: diffuse(reflectance: checkerboard(a: 0.2, b: 0.8)) }
         shape card {
           mesh: mesh(vertices: [[-1, 0, 1], [1, 0, 1], [1, 1, 1], [-1, 1, 1]], faces: [[0, 2, 1], [0, 3, 2]], colors: hue)
           material: diffuse(reflectance: vertex_color())
         }
         light sun = directional(direction: [0.3, -1, 0.2], irradiance: 2)
         let bump = [[exp(-((i - 2) ^ 2 + (j - 2) ^ 2)) / 2 for j in 0..5] for i in 0..5]
         let target = render(eye, spp: 64) with { heights: bump, hue: [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]] }
         loss fit = mse(render(eye, spp: 16), target) + 1e-3 * laplacian_energy(land.mesh)
         optimize fit { using: adam(lr: 0.03), steps: 20 }
         print heights[-1][1..3]
         save land.mesh to \"land.ply\"
         expect heights[2][2] > 0.2 and hue[0].r > hue[0].g",
    );
}

#[test]
fn first_hit_channels_of_a_size() {
    let place = Place::new();
    let script = "param r: scalar = 0.7 in 0.1..2
         shape s { mesh: icosphere(subdivisions: 2) |> scale(r) }
         let views = [depth(eye), alpha(eye), normal(eye)]
         let truth = [depth(eye, spp: 64), alpha(eye, spp: 64), normal(eye, spp: 64)] with { r: 1 }
         loss geometry = sum([l1(a, b) for a, b in zip(views, truth)]) + silhouette_iou(views[1], truth[1])
         optimize geometry { using: rmsprop(lr: 0.02), steps: 20 }
         save normal(eye) * 0.5 + 0.5 to \"normals.png\"
         expect abs(r - 1) < 0.1";
    place.run(&format!("{EYE}{script}"));
}

#[test]
fn the_lights_and_shapes_of_a_gltf_file() {
    let place = Place::new();
    place.write(
        "room.gltf",
        r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"materials":[{"emissiveFactor":[1,1,1]},{"alphaMode":"BLEND","pbrMetallicRoughness":{"baseColorFactor":[0.2,0.4,0.6,0.25]}}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0},{"attributes":{"POSITION":0},"indices":1,"material":1}]}],
"buffers":[{"byteLength":44,"uri":"data:application/octet-stream;base64,AAAAAAAAgD8AAAAAAACAPwAAgD8AAAAAAAAAAAAAgD8AAIA/AAABAAIAAAA="}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":6}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,1,0],"max":[1,1,1]},
{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}]}"#,
    );
    let script = "scene room = load_scene(\"room.gltf\")
         shape parts = load_shapes(\"room.gltf\")
         light lamps = load_lights(\"room.gltf\")
         print len(room.shapes), len(room.lights), len(parts), len(lamps), max(lamps[0].radiance), max(room.shapes[0].material.opacity)
         expect mean(render(eye, scene: room, spp: 4) - render(eye, spp: 4)) < 1";
    assert_eq!(place.run(&format!("{EYE}{script}")).trim(), "1 1 1 1 1 0.25");
}

/// Turns of several things, or of one thing's joints, are one param: it has bounds, a prior, derivatives, a place in files and in found scripts.
#[test]
fn several_angles_are_one_param() {
    let place = Place::new();
    let script = "param tilts: angle[2] = [10deg, 50deg] ~ normal(30deg, [40deg, 50deg]) in 0deg..[90deg, 60deg]
         param turns: angle[3] ~ normal(20deg, 5deg)
         let aims = [rotation(axis: [0, 1, 0], angle: turn) @ [1, 0, 0] for turn in turns]
         loss fit = sum((sin(tilts) - [0.5, 0.95]) ^ 2) + sum((aims - [0.6, 0, -0.8]) ^ 2)
         let exact = 2 * (sin(tilts) - [0.5, 0.95]) * cos(tilts)
         expect max(abs(grad(fit, tilts) - exact)) < 1e-9, \"{grad(fit, tilts)} {exact}\"
         expect max(abs(fd(fit, tilts) - exact)) < 1e-3
         expect abs(grad(fit, tilts[1]) - exact[1]) < 1e-9
         expect abs((fit with { tilts: [30deg, 50deg], turns: 20deg }) - (fit with { tilts[0]: 30deg })) < 1e-9
         print turns
         optimize fit { using: adam(lr: 0.03), steps: 400 }
         print tilts
         expect max(abs((tilts - [30deg, 60deg]) / 1deg)) < 0.1
         expect max(abs(turns / 1rad - acos(0.6) / 1rad)) < 0.01
         save tilts to \"tilts.json\"";
    let printed = place.run(script);
    let [turns, tilts] = printed.lines().collect::<Vec<&str>>()[..] else { panic!("{printed}") };
    assert!(turns == "[20deg, 20deg, 20deg]" && tilts.ends_with("60deg]"), "{printed}");
    // The script that a run leaves has what was found.
    place.write("found.dscene", script);
    assert_code(&place.dsl(&["run", "found.dscene", "--out", "found", "--quiet"]), 0);
    let found = stdout(&place.dsl(&["export", "found", "--script"]));
    assert!(found.contains("param tilts: angle[2] = [") && found.contains("* 1rad"), "{found}");
    place.write("again.dscene", found.replace("optimize", "// optimize"));
    let again = place.dsl(&["eval", "again.dscene", "tilts"]);
    assert!(stdout(&again).contains(tilts), "{} {}", stdout(&again), stderr(&again));
    let set = place.dsl(&["eval", "found.dscene", "tilts", "--set", "tilts=[20deg, 30deg]"]);
    assert!(stdout(&set).contains("[20deg, 30deg]"), "{} {}", stdout(&set), stderr(&set));
    // A number is no angle here either, and bounds are angles.
    for wrong in ["param a = [1deg, 2]", "param a = [10deg, 20deg] in 0..90", "param a = [10deg, 20deg] ~ normal(1, 2)"]
    {
        place.write("wrong.dscene", wrong);
        assert_code(&place.dsl(&["check", "wrong.dscene"]), 1);
    }
}
