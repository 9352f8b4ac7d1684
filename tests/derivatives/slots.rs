//! Every array of a scene that can carry derivatives, reached from the language: reverse mode against central
//! differences of the same expression, over independent seeds.

use dscene::eval::Engine;

use crate::common::{Measured, kept, long, percent, statistics, value_and_param};

/// Repeats of one portion, and of all that are drawn until the error is small.
const PORTION: u64 = 10;
const MOST: u64 = 640;
/// The error over the largest element with which a comparison says something.
const TELLING: f64 = 0.08;
/// The error with which no more is drawn.
fn precise() -> f64 {
    if kept::is_recording() { 0.05 } else { 0.03 * percent().map_or(1.6, |percent| percent.min(2.0)) }
}
/// Standard errors that a difference may have: few repeats do not know their own error well.
const ALLOWED: f64 = 3.5;
/// The long statistics look at every case; otherwise at one in five.
fn every() -> usize {
    if long() { 1 } else { 5 }
}

struct Case {
    name: &'static str,
    param: &'static str,
    scene: &'static str,
    step: f64,
}

const CASES: &[Case] = &[
    Case {
        name: "vertices, and a silhouette",
        param: "param p = [0.1, 0.2, 0]",
        scene: "shape s { mesh: triangle([-1, -1, 0], [1, -0.8, 0], [0, 1, 0.3]) |> translate(p) }\nlight l = constant(1)",
        step: 0.05,
    },
    Case {
        name: "the first keyframe, and normals",
        param: "param p = [0.1, 0.2, 0]",
        scene: "let ball = sphere(subdivisions: 8)\nshape s { mesh: moving(ball |> scale([1, 1.2, 1] + p), ball |> translate([0.6, 0.2, 0])) }\nlight l = point(position: [1, 1, 4], intensity: 20)",
        step: 0.05,
    },
    Case {
        name: "the last keyframe, and normals",
        param: "param p = [0.1, 0.2, 0]",
        scene: "let ball = sphere(subdivisions: 8)\nshape s { mesh: moving(ball, ball |> scale([1, 1.2, 1] + p) |> translate([0.6, 0.2, 0])) }\nlight l = point(position: [1, 1, 4], intensity: 20)",
        step: 0.05,
    },
    Case {
        name: "a point light's first keyframe",
        param: "param p = [0.4, 2.2, 0.5]",
        scene: "shape floor { mesh: rectangle(width: 6, depth: 6) |> translate([0, -1, 0]) }\nshape box { mesh: cube() |> scale(0.5) }\nlight l = moving(point(position: p, intensity: 20), point(position: [1, 2, 1.5], intensity: 10))",
        step: 0.05,
    },
    Case {
        name: "a point light's last keyframe",
        param: "param p = [0.4, 2.2, 0.5]",
        scene: "shape floor { mesh: rectangle(width: 6, depth: 6) |> translate([0, -1, 0]) }\nshape box { mesh: cube() |> scale(0.5) }\nlight l = moving(point(position: [1, 2, 1.5], intensity: 10), point(position: p, intensity: 20))",
        step: 0.05,
    },
    Case {
        name: "where a directional light turns to, and fades to",
        param: "param p = [0.4, -1.2, -0.5]",
        scene: "shape floor { mesh: rectangle(width: 6, depth: 6) |> translate([0, -1, 0]) }\nshape box { mesh: cube() |> scale(0.5) }\nlight l = moving(directional(direction: [0, -1, 0.2], irradiance: 3), directional(direction: p, irradiance: 2 - p.y))",
        step: 0.05,
    },
    Case {
        name: "a spot light",
        param: "param p = [0.3, 0.5, 2.5]",
        scene: "shape s { mesh: rectangle(width: 4, depth: 4) |> rotate(x: 90deg) }\nlight l = spot(position: p, direction: [0.2, p.x - p.y, -1], intensity: 9 * p.z, cutoff: p.z * 12deg, beam: p.x * 20deg)",
        step: 0.02,
    },
    Case {
        name: "a spot light's first keyframe",
        param: "param p = [0.4, 2.2, 0.5]",
        scene: "shape floor { mesh: rectangle(width: 6, depth: 6) |> translate([0, -1, 0]) }\nshape box { mesh: cube() |> scale(0.5) }\nlight l = moving(spot(position: p, direction: [p.z - 0.5, -1, p.x], intensity: 20, cutoff: p.y * 20deg, beam: p.x * 30deg), spot(position: [1, 2, 1.5], direction: [-0.3, -1, -0.2], intensity: 10))",
        step: 0.05,
    },
    Case {
        name: "a spot light's last keyframe",
        param: "param p = [0.4, 2.2, 0.5]",
        scene: "shape floor { mesh: rectangle(width: 6, depth: 6) |> translate([0, -1, 0]) }\nshape box { mesh: cube() |> scale(0.5) }\nlight l = moving(spot(position: [1, 2, 1.5], direction: [-0.3, -1, -0.2], intensity: 10), spot(position: p, direction: [p.z - 0.5, -1, p.x], intensity: 20, cutoff: p.y * 20deg, beam: p.x * 30deg))",
        step: 0.05,
    },
    Case {
        name: "a profile's rotation and texels",
        param: "param p = [0.3, 0.5, 0.8]",
        scene: "let map = image([[1 + sin(i * 45deg + j * 60deg) * p.z for i in 0..8] for j in 0..4])\nshape s { mesh: rectangle(width: 4, depth: 4) |> rotate(x: 90deg) }\nlight l = point(position: [0.2, 0.1, 2], intensity: 9, profile: map, rotation: aim([p.x, 0.2, -1], turn: p.y * 1rad))",
        step: 0.02,
    },
    Case {
        name: "a profile's last keyframe",
        param: "param p = [0.4, 2.2, 0.5]",
        scene: "let map = image([[1 + sin(i * 45deg + j * 60deg) * 0.9 for i in 0..8] for j in 0..4])\nshape floor { mesh: rectangle(width: 6, depth: 6) |> translate([0, -1, 0]) }\nshape box { mesh: cube() |> scale(0.5) }\nlight l = moving(point(position: [1, 2, 1.5], intensity: 20, profile: map), point(position: p, intensity: 20, profile: map, rotation: aim([p.z - 0.5, -1, p.x], turn: p.x * 1rad)))",
        step: 0.05,
    },
    Case {
        name: "a spot light with a profile",
        param: "param p = [0.3, 0.5, 2.5]",
        scene: "let map = image([[1 + sin(i * 45deg + j * 60deg) * p.x for i in 0..8] for j in 0..4])\nshape s { mesh: rectangle(width: 4, depth: 4) |> rotate(x: 90deg) }\nlight l = spot(position: p, direction: [0.2, p.x - p.y, -1], intensity: 9 * p.z, cutoff: p.z * 12deg, beam: p.x * 20deg, profile: map)",
        step: 0.02,
    },
    Case {
        name: "a rotation",
        param: "param p: rotation = euler(y: 20deg)",
        scene: "shape s { mesh: cube() |> rotate(by: p) }\nlight l = directional(direction: [0.3, -1, -2], irradiance: 3)",
        step: 0.03,
    },
    Case {
        name: "normals",
        param: "param p = [0.1, 0.3, 1]",
        scene: "let n = normalize(p)\nshape s { mesh: mesh(vertices: [[-3,-3,0],[3,-3,0],[0,4,0]], faces: [[0,1,2]], normals: [n, [0,0,1], [0,0,1]]) }\nlight l = point(position: [1, 1, 3], intensity: 10)",
        step: 0.02,
    },
    Case {
        name: "uvs",
        param: "param p = [0.2, 0.3]",
        scene: "let t = texture([[0.1, 0.9], [0.3, 0.5]], wrap: clamp)\nshape s { mesh: mesh(vertices: [[-3,-3,0],[3,-3,0],[0,4,0]], faces: [[0,1,2]], uvs: [p, [0.8, 0.4], [0.5, 0.7]]), material: diffuse(reflectance: t) }\nlight l = constant(1)",
        step: 0.02,
    },
    Case {
        name: "uvs of a texture that is mirrored",
        param: "param p = [-0.8, 1.3]",
        scene: "let t = texture([[0.1, 0.9], [0.3, 0.5]], wrap: mirror)\nshape s { mesh: mesh(vertices: [[-3,-3,0],[3,-3,0],[0,4,0]], faces: [[0,1,2]], uvs: [p, [1.6, 0.4], [0.5, -0.7]]), material: diffuse(reflectance: t) }\nlight l = constant(1)",
        step: 0.02,
    },
    Case {
        name: "vertex colours",
        param: "param p = [0.2, 0.5, 0.7]",
        scene: "shape s { mesh: mesh(vertices: [[-3,-3,0],[3,-3,0],[0,4,0]], faces: [[0,1,2]], colors: [p, [1,0,0], [0,1,0]]), material: diffuse(reflectance: vertex_color()) }\nlight l = constant(1)",
        step: 0.05,
    },
    Case {
        name: "texels",
        param: "param p = [[0.2, 0.5], [0.7, 0.4]]",
        scene: "shape s { mesh: rectangle(width: 4, depth: 4) |> rotate(x: 90deg), material: diffuse(reflectance: texture(p)) }\nlight l = constant(1)",
        step: 0.05,
    },
    Case {
        name: "opacities",
        param: "param p = [[0.2, 0.9], [0.7, 0.4]]",
        scene: "shape s { mesh: rectangle(width: 4, depth: 4) |> rotate(x: 90deg) |> translate([0.5, 0, 1]), material: mask(diffuse(reflectance: 0.2), opacity: texture(p, wrap: clamp)) }\nshape wall { mesh: rectangle(width: 9, depth: 9) |> rotate(x: 90deg) }\nlight l = directional(direction: [0.3, -0.5, -1], irradiance: 3)",
        step: 0.05,
    },
    Case {
        name: "the opacity of a shape that moves",
        param: "param p = [0.3, 0.6]",
        scene: "shape s { mesh: rectangle(width: 2, depth: 2) |> rotate(x: 90deg) |> translate([p.x, 0, 1]), material: mask(one_sided(diffuse(reflectance: 0.2)), opacity: p.y) }\nshape wall { mesh: rectangle(width: 9, depth: 9) |> rotate(x: 90deg) }\nlight l = directional(direction: [0.3, -0.5, -1], irradiance: 3)",
        step: 0.05,
    },
    Case {
        name: "a point light",
        param: "param p = [0.3, 0.5, 2.5]",
        scene: "shape s { mesh: rectangle(width: 4, depth: 4) |> rotate(x: 90deg) }\nlight l = point(position: p, intensity: 9 * p.z)",
        step: 0.02,
    },
    Case {
        name: "a directional light",
        param: "param p = [0.3, 0.5, -1]",
        scene: "shape s { mesh: rectangle(width: 4, depth: 4) |> rotate(x: 90deg) }\nlight l = directional(direction: p, irradiance: [1, 2, 3] * p.y)",
        step: 0.02,
    },
    Case {
        name: "an environment's rotation and texels",
        param: "param p = 0.3",
        scene: "let sky = image([[[1 + sin(i * 45deg), 1, p] for i in 0..8] for j in 0..4])\nlight l = environment(sky, rotation: rotation(axis: [0, 1, 0], angle: p * 1rad))\nshape s { mesh: sphere(subdivisions: 12) }",
        step: 0.05,
    },
    Case {
        name: "an area light's size, place and radiance",
        param: "param p = [1, 0.2, 2]",
        scene: "shape s { mesh: rectangle(width: 4, depth: 4) |> rotate(x: 90deg) }\nlight l = area(rectangle(width: p.x, depth: 1) |> rotate(x: -90deg) |> translate([0, p.y, p.z]), radiance: 3 * p.x)",
        step: 0.02,
    },
    Case {
        name: "material numbers",
        param: "param p = [0.4, 0.3]",
        scene: "shape s { mesh: sphere(subdivisions: 16), material: phong(diffuse: p.x, specular: [0.2, 0.3, p.x], roughness: p.y) }\nlight l = directional(direction: [0.3, -0.5, -1], irradiance: 3)",
        step: 0.02,
    },
];

/// Cameras over the same scene of a textured ground and a box.
const CAMERAS: &[(&str, &str, &str, f64)] = &[
    ("position", "param p = [0.2, 1, 4]", "position: p, look_at: [0, 0, 0]", 0.05),
    ("look_at", "param p = [0.2, 0.1, 0]", "position: [0, 1, 4], look_at: p", 0.05),
    ("fov", "param p = 40deg", "position: [0, 1, 4], look_at: [0, 0, 0], fov: p", 0.03),
    ("fov_x", "param p = 55deg", "position: [0, 1, 4], look_at: [0, 0, 0], fov_x: p", 0.03),
    ("height", "param p = 3", "position: [0, 1, 4], look_at: [0, 0, 0], kind: orthographic, height: p", 0.1),
    ("aperture", "param p = 0.4", "position: [0.9, 0.6, 1.6], look_at: [0.3, 0.2, 0], aperture: p, focus: 3", 0.05),
    ("focus", "param p = 0.8", "position: [0.9, 0.6, 1.6], look_at: [0.3, 0.2, 0], aperture: 0.4, focus: p", 0.03),
    (
        "focal length and principal point",
        "param p = [15, 14, 9, 5]",
        "position: [0, 1, 4], look_at: [0, 0, 0], focal: p.xy, principal: p.zw",
        0.3,
    ),
    (
        "focal length of a lens with an aperture, and its sensor",
        "param p = [35, 36, 10]",
        "position: [0.9, 0.6, 1.6], look_at: [0.3, 0.2, 0], aperture: 0.3, focus: 2, focal: p.x, sensor_width: p.y, principal: [p.z, 7]",
        0.3,
    ),
    (
        "distortion",
        "param p = [-0.2, 0.05, 0.01, -0.02, 0.03]",
        "position: [0, 1, 4], look_at: [0, 0, 0], fov: 60deg, distortion: p",
        0.03,
    ),
    (
        "distortion of a lens that has none yet",
        "param p = [0, 0, 0, 0, 0]",
        "position: [0, 1, 4], look_at: [0, 0, 0], fov: 60deg, distortion: p",
        0.03,
    ),
    (
        "distortion of a fisheye, and its fov",
        "param p = [0.05, -0.02, 1.2]",
        "position: [0, 1, 4], look_at: [0, 0, 0], kind: fisheye, fov: p.z * 1rad, distortion: p.xy",
        0.03,
    ),
    (
        "last position of a camera with distortion",
        "param p = [0.2, 1, 4]",
        "position: [0, 0.8, 4], look_at: [0, 0, 0], distortion: [-0.2] => position: p, look_at: [0, 0.2, 0], distortion: [-0.2]",
        0.05,
    ),
    ("look_at in focus", "param p = [0, 0.2, 1]", "position: [0, 1, 4], look_at: p, aperture: 0.4", 0.05),
    (
        "shutter",
        "param p = [0.2, 0.7]\nshape flying { mesh: moving(cube() |> translate([-0.5, 1.2, 0]), cube() |> translate([1.5, 1.4, 0])) }",
        "position: [0, 1, 4], look_at: [0, 0, 0], shutter: p",
        0.05,
    ),
    // From the first keyframe to the last.
    (
        "first position",
        "param p = [0.2, 1, 4]",
        "position: p, look_at: [0, 0, 0] => position: [0.4, 0.8, 3.5], look_at: [0, 0, 0]",
        0.05,
    ),
    (
        "last position",
        "param p = [0.2, 1, 4]",
        "position: [0, 0.8, 4], look_at: [0, 0, 0] => position: p, look_at: [0, 0.2, 0]",
        0.05,
    ),
    (
        "last fov",
        "param p = 50deg",
        "position: [0, 1, 4], look_at: [0, 0, 0], fov: 40deg => position: [0.2, 1, 4], look_at: [0, 0, 0], fov: p",
        0.03,
    ),
    (
        "last aperture and focus",
        "param p = [0.4, 1]",
        "position: [0.9, 0.6, 1.6], look_at: [0.3, 0.2, 0] => position: [0.9, 0.6, 1.6], look_at: [0.3, 0.2, 0], aperture: p.x, focus: p.y",
        0.05,
    ),
    (
        "shutter of a camera that moves",
        "param p = [0.2, 0.7]",
        "position: [0, 1, 4], look_at: [0, 0, 0], shutter: p => position: [1, 1.2, 3.6], look_at: [0.2, 0, 0], shutter: p",
        0.05,
    ),
    ("transform", "param p = [0.2, 1, 4]", "transform: look_at(p, [0, 0, 0])", 0.05),
];

const LOSS: &str =
    "let y = mean(render(eye, spp: 8, max_bounces: 1) * (pixels(eye).x + 2 * pixels(eye).y) * [1, 0.5, 0.25])\n";

/// Means agree within 3.5 combined standard errors, which are a few per cent of the largest element. Differences that are kept count in place of
/// those that are drawn.
fn agree(name: &str, text: &str, step: f64) {
    let (mut engine, y, target) = value_and_param(name, text);
    let of = format!("{text}\n{step}");
    let row = |k: usize| format!("slot of {}, element {k}", name.replace(',', " and"));
    let mut gradient = |seed: u64, engine: &mut Engine| {
        engine.set_sample_seed(seed);
        let found = engine.gradient(&y, std::slice::from_ref(&target)).unwrap_or_else(|e| panic!("{name}: {e:#?}"));
        found.grads[0].data.clone()
    };
    let difference = |seed: u64, engine: &mut Engine| -> Vec<f64> {
        engine.set_sample_seed(seed);
        // A step alone is off by its curvature; two are extrapolated to none (Richardson), which has more noise.
        let mut at =
            |step: f64| engine.finite_difference(&y, &target, step).unwrap_or_else(|e| panic!("{name}: {e:#?}")).data;
        let coarse = at(step);
        at(0.5 * step).iter().zip(&coarse).map(|(f, c)| (4.0 * f - c) / 3.0).collect()
    };
    let mut gradients = Draws::default();
    let mut differences = Draws::default();
    gradients.add(&mut engine, PORTION, &mut gradient);
    let known: Option<Vec<Measured>> = (0..gradients.values.len()).map(|k| kept::difference(&row(k), &of)).collect();
    let known = known.filter(|_| !kept::draws_all());
    let found = loop {
        // Of those that are kept some are drawn in the long statistics, to be compared.
        if known.is_none() || long() && differences.drawn == 0 {
            differences.add(&mut engine, PORTION, &difference);
        }
        assert!(known.is_some() || gradients.values.len() == differences.values.len(), "{name}");
        let of_differences = known.clone().unwrap_or_else(|| differences.measured());
        let found: Vec<[Measured; 2]> =
            gradients.measured().into_iter().zip(of_differences).map(|(g, fd)| [g, fd]).collect();
        let largest = found.iter().map(|f| f[1].mean.abs()).fold(0.0, f64::max);
        assert!(largest > 0.0, "{name}: nothing moves");
        // What is kept has its error, however much is drawn of the other.
        let precise = |f: &[Measured; 2]| {
            f[0].error.hypot(f[1].error) < precise() * largest || known.is_some() && f[0].error < 0.5 * f[1].error
        };
        // Few values do not know their own error: what looks doubtful is drawn on.
        let doubtful =
            |f: &[Measured; 2]| (f[0].mean - f[1].mean).abs() > 2.5 * f[0].error.hypot(f[1].error) + 0.01 * largest;
        let settled = gradients.drawn > PORTION && found.iter().all(precise) && !found.iter().any(doubtful);
        if settled || gradients.drawn >= MOST {
            break found;
        }
        gradients.add(&mut engine, PORTION, &mut gradient);
    };
    let largest = found.iter().map(|f| f[1].mean.abs()).fold(0.0, f64::max);
    for (k, [gradient, difference]) in found.iter().enumerate() {
        let error = gradient.error.hypot(difference.error);
        // A little for the curvature of differences.
        let allowed = ALLOWED * error + 0.01 * largest;
        let off = (gradient.mean - difference.mean).abs();
        assert!(off <= allowed, "{name}, element {k}: gradient {gradient:?}, differences {difference:?}");
        assert!(error < TELLING * largest, "{name}, element {k}: too noisy to tell ({gradient:?}, {difference:?})");
    }
    if long() {
        for (k, drawn) in differences.measured().into_iter().enumerate() {
            kept::record_or_compare(&row(k), &of, drawn, || {
                let mut more = Draws { from: 1_000_000, ..Draws::default() };
                more.add(&mut engine, 8 * PORTION, &difference);
                more.measured()[k]
            });
        }
    }
}

/// Values of independent seeds, element by element.
#[derive(Default)]
struct Draws {
    from: u64,
    drawn: u64,
    values: Vec<Vec<f64>>,
}

impl Draws {
    fn add(&mut self, engine: &mut Engine, count: u64, mut draw: impl FnMut(u64, &mut Engine) -> Vec<f64>) {
        for seed in self.from + self.drawn..self.from + self.drawn + count {
            let found = draw(seed + 1, engine);
            self.values.resize(found.len(), Vec::new());
            self.values.iter_mut().zip(found).for_each(|(values, x)| values.push(x));
        }
        self.drawn += count;
    }

    fn measured(&self) -> Vec<Measured> {
        self.values.iter().map(|values| statistics(values)).collect()
    }
}

#[test]
fn every_slot_of_a_scene() {
    for case in CASES.iter().step_by(every()) {
        let camera = "camera eye { position: [0, 0, 5], look_at: [0, 0, 0], fov: 40deg, film: [16, 12] }";
        agree(case.name, &format!("{}\n{}\n{camera}\n{LOSS}", case.param, case.scene), case.step);
    }
}

#[test]
fn every_slot_of_a_camera() {
    let scene = "
shape ground { mesh: rectangle(width: 9, depth: 9) |> translate([0, -1, 0]), material: diffuse(reflectance: texture([[0.1, 0.8], [0.4, 0.2]])) }
shape box { mesh: cube() |> rotate(y: 30deg), material: diffuse(reflectance: 0.9) }
light l = directional(direction: [0.3, -1, -0.5], irradiance: 3)";
    for (name, param, fields, step) in CAMERAS.iter().step_by(every()) {
        let keyframes: Vec<String> = fields.split(" => ").map(|k| format!("camera({k}, film: [16, 12])")).collect();
        let camera = match &keyframes[..] {
            [opening, closing] => format!("let eye = moving({opening}, {closing})"),
            _ => format!("let eye = {}", keyframes[0]),
        };
        // Silhouettes in differences are noisy: more samples.
        let loss = LOSS.replace("spp: 8", "spp: 32");
        agree(name, &format!("{param}\n{scene}\n{camera}\n{loss}"), *step);
    }
}

/// Every variant of `Slot` is in a case above: who adds one adds a case, or this does not compile.
#[test]
fn every_slot_has_a_case() {
    use dscene::render::Slot;
    let all = [
        Slot::Vertices(0),
        Slot::Normals(0),
        Slot::Uvs(0),
        Slot::Colors(0),
        Slot::Texels(0),
        Slot::LightPlacement(0),
        Slot::LightPower(0),
        Slot::LightAxis(0),
        Slot::LightCone(0),
        Slot::LightRotation(0),
        Slot::EnvironmentRotation,
        Slot::CameraOrigin,
        Slot::CameraFrame,
        Slot::CameraScale,
        Slot::CameraLens,
        Slot::CameraDistortion,
        Slot::ClosingVertices(0),
        Slot::ClosingNormals(0),
        Slot::ClosingLightPlacement(0),
        Slot::ClosingLightPower(0),
        Slot::ClosingLightAxis(0),
        Slot::ClosingLightCone(0),
        Slot::ClosingLightRotation(0),
        Slot::ClosingCameraOrigin,
        Slot::ClosingCameraFrame,
        Slot::ClosingCameraScale,
        Slot::ClosingCameraLens,
        Slot::CameraShutter,
    ];
    for slot in all {
        let (case, is_camera) = match slot {
            Slot::Vertices(_) => ("vertices, and a silhouette", false),
            Slot::Normals(_) => ("normals", false),
            Slot::Uvs(_) => ("uvs", false),
            Slot::Colors(_) => ("vertex colours", false),
            Slot::Texels(_) => ("texels", false),
            Slot::LightPlacement(_) | Slot::LightPower(_) => ("a point light", false),
            Slot::LightAxis(_) | Slot::LightCone(_) => ("a spot light", false),
            Slot::LightRotation(_) => ("a profile's rotation and texels", false),
            Slot::ClosingLightRotation(_) => ("a profile's last keyframe", false),
            Slot::EnvironmentRotation => ("an environment's rotation and texels", false),
            Slot::ClosingVertices(_) | Slot::ClosingNormals(_) => ("the last keyframe, and normals", false),
            Slot::ClosingLightPlacement(_) | Slot::ClosingLightPower(_) => ("a point light's last keyframe", false),
            Slot::ClosingLightAxis(_) | Slot::ClosingLightCone(_) => ("a spot light's last keyframe", false),
            Slot::CameraOrigin => ("position", true),
            Slot::CameraFrame => ("look_at", true),
            Slot::CameraScale => ("fov", true),
            Slot::CameraLens => ("aperture", true),
            Slot::CameraDistortion => ("distortion", true),
            Slot::ClosingCameraOrigin => ("last position", true),
            Slot::ClosingCameraFrame => ("last position", true),
            Slot::ClosingCameraScale => ("last fov", true),
            Slot::ClosingCameraLens => ("last aperture and focus", true),
            Slot::CameraShutter => ("shutter", true),
        };
        let known = if is_camera { CAMERAS.iter().any(|c| c.0 == case) } else { CASES.iter().any(|c| c.name == case) };
        assert!(known, "{slot:?} has no case `{case}`");
    }
}
