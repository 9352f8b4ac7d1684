//! Derivatives of the library: forward and reverse mode against finite differences, function by function.

use dscene::check::{self, Checked, Disk, Line, hir::DeclKind};
use dscene::diag::Diagnostic;
use dscene::eval::value::Value;
use dscene::eval::{Engine, EngineOptions, on_large_stack};

const PARAMS: &str = "
param s = 0.7
param t = 1.3
param turn = 25deg
param v = [0.3, -0.5, 0.8]
param w = [1.1, 0.4, -0.6]
param six = [1, 0.2, -0.3, 0.1, 0.8, 0.5]
param four = [0.7, 0.1, -0.4, 0.3]
param m = [[1.2, 0.3, -0.4], [0.2, 0.9, 0.5], [-0.1, 0.6, -0.8]]
param n = [[0.5, -1.2], [0.8, 0.3], [1.4, -0.2]]
param im = [[[0.2, 0.9], [0.6, 0.1], [0.35, 0.75]], [[0.5, 0.31], [0.15, 0.45], [0.8, 0.55]]]
param points = [[0.3, 0.1, 0.2], [-0.4, 0.65, -0.1], [0.2, -0.6, 0.4], [0.7, 0.3, -0.5]]
let photo = image([[[0.5, 0.3], [0.1, 0.8], [0.7, 0.2]], [[0.9, 0.6], [0.4, 0.25], [0.05, 0.65]]])
let mask = image([[[1], [0], [0.5]], [[0.2], [1], [0]]])
let body = mesh(vertices: points, faces: [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]) |> smooth_normals()
camera eye { position: [1, 2, 6], look_at: v, fov: turn * 2, film: [64, 48] }
camera wide { position: 2 * w, look_at: v, fov: 150deg, kind: fisheye, distortion: [0.3 * s, 0.02], film: [64, 48] }
camera flat { position: 4 * w, look_at: v, kind: orthographic, height: 3 * t, film: [64, 48] }
camera round { position: 4 * w, look_at: v, kind: panorama, film: [64, 48] }
";

/// A native, what is differentiated, and in which param.
const DERIVATIVES: &[(&str, &str, &str)] = &[
    ("abs", "abs(v)", "v"),
    ("exp", "exp(v)", "v"),
    ("log", "log(v + 1)", "v"),
    ("sqrt", "sqrt(v + 1)", "v"),
    ("tanh", "tanh(v)", "v"),
    ("pow", "pow(v + 1, s)", "v"),
    ("pow", "pow(v + 1, s)", "s"),
    ("pow", "pow(v + 1, w)", "w"),
    ("sin", "sin(turn)", "turn"),
    ("sin", "sin(v * 1rad)", "v"),
    ("sin", "sin(image(im) * 40deg)", "im"),
    ("cos", "cos(turn)", "turn"),
    ("tan", "tan(turn)", "turn"),
    ("tan", "tan([turn, 2 * turn])", "turn"),
    ("prior", "prior(v, normal(w, 0.3))", "v"),
    ("prior", "prior(v, normal(w, [0.3, 1, 2]))", "w"),
    ("prior", "prior(image(im), normal([0.2, 0.5], 0.1))", "im"),
    ("prior", "prior(turn, normal(10deg, 5deg))", "turn"),
    ("prior", "prior(v + 1, log_normal(w + 2, 0.3))", "v"),
    ("prior", "prior(v + 1, log_normal(w + 2, 0.3))", "w"),
    ("middle", "middle(normal_distribution(v, 1))", "v"),
    ("middle", "middle(uniform_distribution(v, v + t))", "t"),
    ("clear_sky", "clear_sky(w, turbidity: 2.5, width: 8)", "w"),
    ("clear_sky", "clear_sky(w, turbidity: t + 1, ground: 0.3, width: 8)", "t"),
    ("clear_sky", "clear_sky([0.2, 0.4, 0.3], ground: v ^ 2, width: 8)", "v"),
    ("sun_irradiance", "sun_irradiance(w, turbidity: 2)", "w"),
    ("sun_irradiance", "sun_irradiance([1, 0.2, 0], turbidity: t + 1)", "t"),
    ("asin", "asin(s) / 1rad", "s"),
    ("acos", "acos(s) / 1rad", "s"),
    ("acos", "acos(v) / 1rad", "v"),
    ("atan", "atan(s) / 1rad", "s"),
    ("atan", "atan(image(im)) / 1rad", "im"),
    ("atan2", "atan2(s, -t) / 1rad", "s"),
    ("atan2", "atan2(v, w) / 1rad", "w"),
    ("atan2", "atan2(s, -t) / 1rad", "t"),
    ("dot", "dot(v, w)", "v"),
    ("cross", "cross(v, w)", "w"),
    ("length", "length(v)", "v"),
    ("normalize", "normalize(v)", "v"),
    ("normalize", "normalize(body).vertices", "points"),
    ("clamp", "clamp(v, -0.4, 0.9)", "v"),
    ("mod", "mod(3 * v, s)", "v"),
    ("mod", "mod(3 * v, s)", "s"),
    ("mod", "mod([3 * turn, turn], 40deg) / 1rad", "turn"),
    ("where", "where(v > 0, v ^ 2, exp(v))", "v"),
    ("where", "where(v > 0, 3 * turn, 10deg) / 1rad", "turn"),
    ("where", "where(image(im) > 0.4, 0.1, image(im) ^ 2)", "im"),
    ("min", "min(v, w)", "v"),
    ("min", "min(n, axis: 0)", "n"),
    ("max", "max(v, w)", "w"),
    ("max", "max(image(im), axis: 2)", "im"),
    ("sum", "sum(n)", "n"),
    ("sum", "sum(n ^ 2, axis: 1)", "n"),
    ("mean", "mean(image(im) ^ 2, axis: [0, 1])", "im"),
    ("norm", "norm(n, axis: 0)", "n"),
    ("norm", "norm([turn, 10deg]) / 1rad", "turn"),
    ("variance", "variance(n, axis: 0)", "n"),
    ("std", "std(im)", "im"),
    ("median", "median(im, axis: 0)", "im"),
    ("percentile", "percentile(n, 30)", "n"),
    ("percentile", "percentile(n, 100, axis: 1)", "n"),
    ("sort", "sort(n, axis: 0, descending: true) * [[1, 2], [3, 4], [5, 6]]", "n"),
    ("concat", "concat(v, 2 * w)", "w"),
    ("concat", "concat(image(im), 2 * image(im), axis: 1)", "im"),
    ("stack", "stack([image(im), image(im) ^ 2])", "im"),
    ("reshape", "reshape(n, [2, 3]) * [1, 2, 3]", "n"),
    ("reshape", "reshape([turn, 2 * turn], [2, 1]) / 1rad", "turn"),
    ("transpose", "transpose(n) * [1, 2, 3]", "n"),
    ("transpose", "matrix(transpose(rotation(angle: turn)))", "turn"),
    ("inverse", "inverse(m)", "m"),
    ("inverse", "matrix(inverse(rotation(angle: turn) @ scaling(1 + v / 2)))", "v"),
    ("determinant", "determinant(m)", "m"),
    ("determinant", "determinant(transpose(n) @ n)", "n"),
    ("determinant", "determinant(transpose(concat(im[0], im[1])) @ concat(im[0], im[1]))", "im"),
    ("rotation", "matrix(rotation(axis: v, angle: turn))", "v"),
    ("rotation", "matrix(rotation(axis: v, angle: turn))", "turn"),
    ("rotation", "matrix(rotation(matrix: m))", "m"),
    ("rotation", "matrix(rotation(matrix: m + [[0, 0, 0], [0, 0, 0], [0, 0, 2]]))", "m"),
    ("rotation", "matrix(rotation(quaternion: four))", "four"),
    ("rotation", "matrix(rotation(six: six))", "six"),
    ("euler", "matrix(euler(x: turn, z: 2 * turn))", "turn"),
    ("translation", "translation(v) @ w", "v"),
    ("scaling", "scaling(v) @ w", "v"),
    ("look_at", "matrix(look_at(v, w))", "v"),
    ("aim", "matrix(aim(v, turn: turn))", "v"),
    ("aim", "matrix(aim(v, turn: turn))", "turn"),
    ("compose", "matrix(compose(rotation(angle: turn), translation(v)))", "v"),
    ("matrix", "matrix(rotation(angle: turn))", "turn"),
    ("minibatch", "minibatch(v ^ 2, 2)", "v"),
    ("zip", "[a * b for a, b in zip(v, w)]", "v"),
    ("image", "image(im)", "im"),
    ("crop", "crop(image(im), x: 1, y: 0, width: 2, height: 1)", "im"),
    ("resize", "resize(image(im), width: 5, height: 4)", "im"),
    ("blur", "blur(image(im), sigma: 0.7)", "im"),
    ("downsample", "downsample(image(im))", "im"),
    ("pyramid", "pyramid(image(im), levels: 2)[1]", "im"),
    ("luminance", "luminance(v)", "v"),
    ("gradient", "gradient(image(im))", "im"),
    ("flip", "flip(image(im)) * image(im)", "im"),
    ("pad", "pad(image(im), left: 2, bottom: 1, mode: mirror)", "im"),
    ("pad", "pad(image(im), left: 2, bottom: 1, value: s)", "s"),
    ("sample", "sample(image(im), n / 3 + [0.3, 0.6])", "im"),
    ("sample", "sample(image(im), n / 3 + [0.3, 0.6])", "n"),
    ("sample", "sample(image(im), 0.9 * n, wrap: repeat)", "n"),
    ("montage", "montage([image(im), crop(image(im) ^ 2, width: 2, height: 1)], gap: 1, value: s)", "im"),
    ("montage", "montage([image(im), crop(image(im) ^ 2, width: 2, height: 1)], gap: 1, value: s)", "s"),
    ("colormap", "colormap(image(im).x, map: inferno)", "im"),
    ("colormap", "colormap(image(im).y - 0.4, map: diverging, high: t)", "t"),
    ("rectangle", "rectangle(width: s, depth: t).vertices", "s"),
    ("cube", "cube(size: v + 1).vertices", "v"),
    ("sphere", "sphere(radius: s, subdivisions: 5).vertices", "s"),
    ("icosphere", "icosphere(radius: s, subdivisions: 0).vertices", "s"),
    ("disk", "disk(radius: s, subdivisions: 5).vertices", "s"),
    ("cylinder", "cylinder(radius: s, height: t, subdivisions: 5).vertices", "t"),
    ("cone", "cone(radius: s, height: t, subdivisions: 5).vertices", "s"),
    ("torus", "torus(radius: t, tube: s / 3, subdivisions: 5).vertices", "s"),
    ("grid", "grid(width: s, columns: 2, rows: 2).vertices", "s"),
    ("heightfield", "heightfield(n).vertices", "n"),
    ("mesh", "body.vertices", "points"),
    ("translate", "(body |> translate(v)).vertices", "v"),
    ("rotate", "(body |> rotate(axis: v, angle: turn)).vertices", "turn"),
    ("scale", "(body |> scale(v)).vertices", "v"),
    ("transform", "(body |> transform(m)).normals", "m"),
    ("smooth_normals", "smooth_normals(body).normals", "points"),
    ("flat_normals", "flat_normals(body).vertices", "points"),
    ("subdivide", "subdivide(body).normals", "points"),
    ("merge", "merge(body, body).vertices", "points"),
    ("center", "center(body).vertices", "points"),
    ("bounds", "bounds(body)", "points"),
    ("surface_area", "surface_area(body)", "points"),
    ("volume", "volume(body)", "points"),
    ("centroid", "centroid(body)", "points"),
    ("chamfer", "chamfer(points, icosphere(subdivisions: 0))", "points"),
    ("laplacian_energy", "laplacian_energy(body)", "points"),
    ("edge_length_energy", "edge_length_energy(body)", "points"),
    ("normal_consistency", "normal_consistency(body)", "points"),
    ("bending_energy", "bending_energy(body)", "points"),
    ("volume_energy", "volume_energy(body, wanted: 0.2)", "points"),
    // Losses, weighted and not; the mask is an image of one channel.
    ("weighted_mean", "weighted_mean(image(im), weight: mask)", "im"),
    ("mse", "mse(image(im), photo)", "im"),
    ("mse", "mse(image(im), photo, weight: mask)", "im"),
    ("mse", "mse(v, w, weight: [1, 0, s])", "s"),
    ("l1", "l1(image(im), photo, weight: mask)", "im"),
    ("l2", "l2(image(im), photo, weight: mask)", "im"),
    ("huber", "huber(image(im), photo, delta: 0.23, weight: mask)", "im"),
    ("relative_mse", "relative_mse(image(im), photo, weight: mask)", "im"),
    ("smape", "smape(image(im), photo, weight: mask)", "im"),
    ("psnr", "psnr(image(im), photo, weight: mask)", "im"),
    ("ssim", "ssim(image(im), photo, weight: mask)", "im"),
    (
        "ms_ssim",
        "ms_ssim(resize(image(im), 32, 20), 0.1 * resize(photo, 32, 20) + 0.7 * resize(image(im) ^ 2, 32, 20))",
        "im",
    ),
    (
        "ms_ssim",
        "ms_ssim(resize(image(im), 32, 20), 0.1 * resize(photo, 32, 20) + 0.7 * resize(image(im) ^ 2, 32, 20), weight: resize(mask, 32, 20))",
        "im",
    ),
    ("silhouette_iou", "silhouette_iou(image(im), photo, weight: mask)", "im"),
    ("charbonnier", "charbonnier(image(im), photo, epsilon: 0.1, weight: mask)", "im"),
    ("log_mse", "log_mse(image(im), photo, weight: mask)", "im"),
    ("scaled_mse", "scaled_mse(image(im), photo, weight: mask)", "im"),
    ("angle_error", "angle_error(points, [v, w, v, w], weight: [1, 0, 0.5, 2])", "points"),
    ("cross_entropy", "cross_entropy(image(im), photo, weight: mask)", "im"),
    ("pyramid_loss", "pyramid_loss(image(im), photo, levels: 2, loss: l1)", "im"),
    ("pyramid_loss", "pyramid_loss(image(im), photo, levels: 2, weight: mask)", "im"),
    ("pyramid_loss", "pyramid_loss(3 * photo, photo ^ 2, levels: 2, weight: image(im))", "im"),
    ("blur", "blur(image(im), sigma: s)", "s"),
    ("blur", "blur(image(im) * s, sigma: s)", "s"),
    ("ssim_luminance", "ssim_luminance(image(im), photo, sigma: s)", "s"),
    ("percentile", "percentile(v, 60 * s)", "s"),
    ("percentile", "percentile(n, percent: 50 * t, axis: 0)", "t"),
    ("uniform", "uniform([5], low: s, high: 3, seed: 2)", "s"),
    ("uniform", "uniform([5], low: s, high: t, seed: 2)", "t"),
    ("gradient_l1", "gradient_l1(image(im), photo)", "im"),
    ("gradient_l1", "gradient_l1(image(im), photo, weight: mask + 0.3)", "im"),
    ("total_variation", "total_variation(image(im))", "im"),
    ("total_variation", "total_variation(photo, weight: image(im))", "im"),
    ("smoothness", "smoothness(image(im), weight: mask + 0.3)", "im"),
    ("guided_variation", "guided_variation(image(im), photo, sharpness: 2, weight: mask + 0.1)", "im"),
    ("guided_variation", "guided_variation(photo, image(im), sharpness: 2)", "im"),
    ("beyond", "beyond(image(im), 0.25, 0.7, weight: mask)", "im"),
    ("indecision", "indecision(image(im), weight: mask)", "im"),
    ("project", "project(eye, points)", "points"),
    ("project", "project(eye, points)", "v"),
    ("project", "project(eye, points)", "turn"),
    ("project", "project(wide, points)", "points"),
    ("project", "project(wide, points)", "w"),
    ("project", "project(wide, points)", "s"),
    ("project", "project(flat, points)", "t"),
    ("project", "project(flat, points)", "w"),
    ("project", "project(round, points)", "v"),
    // Operators, under the names that they would have.
    ("@", "m @ v", "m"),
    ("@", "v @ n", "v"),
    ("@", "m @ n", "n"),
    ("@", "rotation(angle: turn) @ points", "turn"),
    ("@", "(translation(v) @ rotation(angle: turn) @ body).vertices", "turn"),
    ("@", "(scaling(v) @ body).normals", "v"),
    ("@", "matrix(rotation(axis: v, angle: 20deg) @ rotation(axis: w, angle: 50deg))", "v"),
    ("@", "n @ image(im)", "im"),
    ("@", "n @ image(im)", "n"),
    ("[]", "image(im)[1, 2]", "im"),
    ("to_srgb", "to_srgb(image(im) - 0.2)", "im"),
    ("from_srgb", "from_srgb(image(im) - 0.2)", "im"),
    ("quaternion", "matrix(quaternion(s, t, 0.2, -0.4))", "s"),
];

/// Natives without a derivative of their own, and why.
const NONE: &[(&str, &[&str])] = &[
    (
        "flat, constant or made of whole numbers",
        &[
            "sign",
            "floor",
            "ceil",
            "round",
            "stop_gradient",
            "argmin",
            "argmax",
            "is_nan",
            "len",
            "all",
            "any",
            "noise",
            "pixels",
            "teapot",
            "checkerboard",
            "plateau",
            "converged",
        ],
    ),
    ("in single precision, which has too few digits for these differences: `networks` tests it", &["classifier"]),
    ("to report, not to follow", &["flip_map", "perceptual_error"]),
    ("derivatives themselves", &["grad", "jvp", "jacobian", "fd", "estimate"]),
    (
        "settings",
        &[
            "sgd",
            "adam",
            "adam_uniform",
            "rmsprop",
            "lbfgs",
            "levenberg_marquardt",
            "gauss_newton",
            "laplacian",
            "pyramid_preconditioner",
            "auto",
            "normal_distribution",
            "uniform_distribution",
            "log_normal_distribution",
            "integrator",
        ],
    ),
    (
        "parts of a scene, which carry numbers to `render` as they are",
        &[
            "diffuse",
            "conductor",
            "phong",
            "plastic",
            "cloth",
            "mirror",
            "dielectric",
            "thin_dielectric",
            "principled",
            "one_sided",
            "mask",
            "normal_map",
            "brushed",
            "sheened",
            "coated",
            "blend",
            "texture",
            "vertex_color",
            "shape",
            "light",
            "area",
            "point",
            "spot",
            "directional",
            "environment",
            "constant",
            "scene",
            "camera",
            "moving",
        ],
    ),
    (
        "renderings: `finite_differences`, `slots`, `random_scenes` and others test these",
        &["render", "depth", "alpha", "position", "normal", "geometric_normal", "albedo", "uv", "shape_index"],
    ),
    ("the scene that renderings show, in `scene_files`", &["_file_scene"]),
];

fn engine() -> Engine {
    let Checked { program, diagnostics, .. } = check::check_text("test.dscene", None, PARAMS, &[], &Disk);
    assert!(diagnostics.iter().all(|d| !d.is_error()), "{diagnostics:#?}");
    Engine::new(program.expect("a program"), EngineOptions { base_dir: ".".into(), ..Default::default() })
}

/// What the checker has against a line, or else the evaluator; and whether it was the checker.
fn fault(engine: &mut Engine, text: &str) -> Option<(bool, Diagnostic)> {
    let mut program = engine.program().clone();
    match check::check_line(&mut program, text) {
        (Some(Line::Expr(e)), diagnostics) => {
            let seen = diagnostics.into_iter().next().map(|d| (true, d));
            seen.or_else(|| engine.eval(&e).err().map(|d| (false, d)))
        }
        (_, diagnostics) => diagnostics.into_iter().next().map(|d| (true, d)),
    }
}

fn value(engine: &mut Engine, text: &str) -> Value {
    let mut program = engine.program().clone();
    let e = match check::check_line(&mut program, text) {
        (Some(Line::Expr(e)), _) => e,
        (_, diagnostics) => panic!("{text}: {diagnostics:#?}"),
    };
    engine.eval(&e).unwrap_or_else(|d| panic!("{text}: {d:#?}"))
}

fn numbers(engine: &mut Engine, text: &str) -> Vec<f64> {
    match value(engine, text) {
        Value::Bool(truth) => vec![f64::from(u8::from(truth))],
        value => value.var().unwrap_or_else(|| panic!("{text} is not made of numbers")).value().data.clone(),
    }
}

#[test]
fn both_modes_agree_with_differences() {
    on_large_stack(|| {
        let mut engine = engine();
        let mut wrong = Vec::new();
        for (name, of, wrt) in DERIVATIVES {
            // Not linear, so that no sum of derivatives is 0 by symmetry. Projection has 24 bits.
            let loss = format!("sum(({of} + 0.3) ^ 3)");
            let (step, tolerance) = if *name == "project" { (4e-3, 1e-3) } else { (1e-5, 1e-6) };
            let reverse = numbers(&mut engine, &format!("grad({loss}, {wrt})"));
            let forward = numbers(&mut engine, &format!("jacobian({loss}, {wrt})"));
            let differences = numbers(&mut engine, &format!("fd({loss}, {wrt}, step: {step})"));
            let size = differences.iter().fold(1e-3f64, |s, x| s.max(x.abs()));
            let near = |a: &[f64], b: &[f64], most: f64| {
                a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= most * size)
            };
            if !near(&reverse, &forward, 1e-2 * tolerance) || !near(&reverse, &differences, tolerance) {
                wrong.push(format!(
                    "{of} in {wrt}: reverse {reverse:?}, forward {forward:?}, differences {differences:?}"
                ));
            }
            if size <= 1e-3 {
                wrong.push(format!("{of} does not depend on {wrt}"));
            }
        }
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    });
}

#[test]
fn every_native_has_a_test_of_its_derivative_or_none() {
    let engine = engine();
    let natives: Vec<&str> = engine
        .program()
        .decls
        .iter()
        .filter(|d| !d.user && matches!(d.kind, DeclKind::Native(_)))
        .map(|d| d.name.as_str())
        .collect();
    let tested = |name: &str| DERIVATIVES.iter().any(|(n, ..)| *n == name);
    let none = |name: &str| name.starts_with("load") || NONE.iter().any(|(_, names)| names.contains(&name));
    for name in &natives {
        assert!(
            tested(name) != none(name),
            "`{name}` has no test of its derivative here, or is among those without one"
        );
    }
    for name in NONE.iter().flat_map(|(_, names)| names.iter()) {
        assert!(natives.contains(name), "there is no `{name}`");
    }
}

/// Expressions and the numbers that they are.
const VALUES: &[(&str, &[f64])] = &[
    ("[[1, 2], [3, 4]] @ [5, 6]", &[17.0, 39.0]),
    ("[5, 6] @ [[1, 2], [3, 4]]", &[23.0, 34.0]),
    ("mse([1, 2, 3], [2, 2, 5], weight: [1, 1, 0.5])", &[3.0 / 2.5]),
    ("mse(photo, 0 * photo, weight: mask)", &[(0.34 / 2.0 + 0.5 * 0.53 / 2.0 + 0.2 * 1.17 / 2.0 + 0.2225 / 2.0) / 2.7]),
    ("l1([1, 2], [2, 4], weight: 0)", &[0.0]),
    ("ms_ssim(resize(photo, 40, 40), resize(photo, 40, 40))", &[1.0]),
    ("ms_ssim(resize(photo, 40, 40), resize(photo, 40, 40), weight: resize(mask, 40, 40))", &[1.0]),
    // Equal silhouettes are best, whatever their edges; without edges it is intersection over union.
    ("silhouette_iou(mask, mask)", &[0.0]),
    ("silhouette_iou(0 * mask, 0 * mask)", &[0.0]),
    ("silhouette_iou(image([[1, 1, 0]]), image([[0, 1, 1]]))", &[2.0 / 3.0]),
    ("silhouette_iou(image([[0.5, 1]]), image([[1, 1]]))", &[1.0 / 7.0]),
    ("silhouette_iou(image([[0.5, 1, 0.3]]), image([[1, 1, 0.9]]), weight: image([[1, 1, 0]]))", &[1.0 / 7.0]),
    // The hidden third pixel has no part in any difference, although the last pixels of rows and columns count as differences of nothing.
    ("total_variation(image([[0, 2, 5]]), weight: image([[1, 1, 0]]))", &[2.0 / 3.0]),
    ("smoothness(image([[0, 2, 5]]), weight: image([[1, 1, 0]]))", &[4.0 / 3.0]),
    ("gradient_l1(image([[0, 1, 5]]), image([[0, 3, 9]]), weight: image([[1, 1, 0]]))", &[2.0 / 3.0]),
    ("guided_variation(image([[0, 1, 5]]), 0 * image([[0, 1, 5]]), weight: image([[1, 1, 0]]))", &[1.0]),
    ("beyond([-1, 5], 0, 1, weight: [1, 0])", &[1.0]),
    ("indecision([0, 0.5], weight: [3, 1])", &[0.25]),
    // Neither does it reach the coarse level, where the pixel is the mean of what counts.
    (
        "pyramid_loss(image([[1, 9], [1, 9]]), image([[3, 0], [3, 5]]), levels: 2, weight: image([[1, 0], [1, 0]]))",
        &[4.0],
    ),
    ("pyramid_loss(photo, photo ^ 2, levels: 2, weight: 3) - pyramid_loss(photo, photo ^ 2, levels: 2)", &[0.0]),
    // A cube's edges bend by a right angle: 12 of length 1 between faces of area 1/2 each, and 6 diagonals that do not bend.
    ("bending_energy(cube())", &[72.0]),
    ("bending_energy(cube() |> scale(7))", &[72.0]),
    ("volume_energy(cube() |> scale(2), wanted: 4 * volume(cube()))", &[1.0]),
    ("[[1, 2, 3]] @ [[1], [2], [3]]", &[14.0]),
    ("[1, 2] @ [3, 4]", &[11.0]),
    // `@` binds as `*` does, from the left.
    ("2 * [[0, 1], [1, 0]] @ [1, 2] + [1, 1]", &[5.0, 3.0]),
    ("-[[0, 1], [1, 0]] @ [1, 2]", &[-2.0, -1.0]),
    ("rotation(axis: [0, 0, 1], angle: 90deg) @ [1, 0, 0]", &[0.0, 1.0, 0.0]),
    ("rotation(axis: [0, 0, 1], angle: 90deg) @ [[1, 0, 0], [0, 1, 0]]", &[0.0, 1.0, 0.0, -1.0, 0.0, 0.0]),
    ("translation([1, 2, 3]) @ scaling(2) @ [1, 1, 1]", &[3.0, 4.0, 5.0]),
    ("compose(scaling(2), translation([1, 2, 3])) @ [1, 1, 1]", &[3.0, 4.0, 5.0]),
    ("max(abs((translation([1, 2, 3]) @ cube()).vertices - (cube() |> translate([1, 2, 3])).vertices))", &[0.0]),
    ("matrix(inverse(translation([1, 2, 3]) @ scaling(2)))[0]", &[0.5, 0.0, 0.0, -0.5]),
    ("inverse([[2, 1], [1, 1]])", &[1.0, -1.0, -1.0, 2.0]),
    ("determinant([[0, 0, 0, 2], [0, 0, 3, 0], [0, 4, 0, 0], [5, 0, 0, 0]])", &[120.0]),
    ("determinant([[0, 1], [1, 0]])", &[-1.0]),
    ("determinant([[1, 2], [2, 4]])", &[0.0]),
    ("quaternion(2, 0, 0, 2) @ [1, 0, 0]", &[0.0, 1.0, 0.0]),
    ("matrix(rotation(matrix: [[0, -2, 0], [3, 0, 0], [0, 0, 0.5]]))", &[0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
    // Of a matrix that mirrors, the least stretched direction turns round.
    ("matrix(rotation(matrix: [[3, 0, 0], [0, 2, 0], [0, 0, -1]]))", &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
    ("rotation(six: [0, 2, 0, -1, 5, 0]) @ [1, 0, 0]", &[0.0, 1.0, 0.0]),
    ("sum([[1, 2, 3], [4, 5, 6]], axis: 0)", &[5.0, 7.0, 9.0]),
    ("sum([[1, 2, 3], [4, 5, 6]], axis: -1)", &[6.0, 15.0]),
    ("mean(image([[[1, 2], [3, 4]]]), axis: [0, 1])", &[2.0, 3.0]),
    ("image([[[1, 2], [3, 4]]]) - mean(image([[[1, 2], [3, 4]]]), axis: 2)", &[-0.5, 0.5, -0.5, 0.5]),
    ("max([[1, 5], [3, 2]], axis: 0)", &[3.0, 5.0]),
    ("variance([1, 2, 3, 4])", &[1.25]),
    ("std([[1, 3], [2, 2]], axis: 1)", &[1.0, 0.0]),
    ("median([5, 1, 2])", &[2.0]),
    ("median([5, 1, 2, 4])", &[3.0]),
    ("median(stack([image([[1, 2]]), image([[9, 0]]), image([[3, 1]])]), axis: 0)", &[3.0, 1.0]),
    ("percentile([0, 10, 20], 75)", &[15.0]),
    ("sort([[3, 1], [2, 5]])", &[1.0, 3.0, 2.0, 5.0]),
    ("sort([3, 1, 2], descending: true)", &[3.0, 2.0, 1.0]),
    ("argmax([[1, 5], [5, 2]])", &[0.0, 1.0]),
    ("argmin([3, 1, 1])", &[1.0]),
    ("argmax([[1, 5], [3, 2]], axis: 0)", &[1.0, 0.0]),
    ("mod([5, -1, 7.5], 3)", &[2.0, 2.0, 1.5]),
    ("mod(-30deg, 360deg) / 1deg", &[330.0]),
    ("where([1, 2, 3] >= 2, [10, 20, 30], 0)", &[0.0, 20.0, 30.0]),
    ("where(1 > 2, [1, 2], [3, 4])", &[3.0, 4.0]),
    ("not ([1, 2, 3] > 1) or [1, 2, 3] > 2", &[1.0, 0.0, 1.0]),
    ("all([1, 2] > 0)", &[1.0]),
    ("any([1, 2] > 2)", &[0.0]),
    ("concat(image([[1, 2]]), image([[3]]), axis: 1)", &[1.0, 2.0, 3.0]),
    ("concat([image([[1]]), image([[2]]), image([[3]])], axis: 2)", &[1.0, 2.0, 3.0]),
    ("concat([[1, 2], [3, 4]], [[5], [6]], axis: -1)", &[1.0, 2.0, 5.0, 3.0, 4.0, 6.0]),
    ("concat([[1, 2], [3, 4]])", &[1.0, 2.0, 3.0, 4.0]),
    ("pad(image([[1, 2, 3]]), left: 2, right: 1, mode: mirror)", &[2.0, 1.0, 1.0, 2.0, 3.0, 3.0]),
    ("pad(image([[1, 2, 3]]), left: 2, right: 1, mode: wrap)", &[2.0, 3.0, 1.0, 2.0, 3.0, 1.0]),
    ("pad(image([[1, 2]]), left: 1, top: 1, value: 7)", &[7.0, 7.0, 7.0, 7.0, 1.0, 2.0]),
    ("sample(image([[0, 1], [2, 3]]), [0.5, 0.5])", &[1.5]),
    ("sample(image([[0, 1], [2, 3]]), [[0.25, 0.25], [0, 1], [0.5, 0.75]])", &[0.0, 2.0, 2.5]),
    ("sample(image([[0, 1]]), [0, 0.5], wrap: repeat)", &[0.5]),
    ("max(abs(sample(image(im), pixels(camera(film: [3, 2]))) - image(im)))", &[0.0]),
    ("image(im)[1, 2]", &[0.8, 0.55]),
    ("image(im)[-1, 0, 1]", &[0.31]),
    ("[[1, 2, 3], [4, 5, 6]][1, 1..]", &[5.0, 6.0]),
    ("to_srgb([0, 0.5, 1])", &[0.0, 0.735356983052449, 1.0]),
    ("from_srgb(to_srgb([0, 0.001, 0.3, 1]))", &[0.0, 0.001, 0.3, 1.0]),
    ("montage([image([[1, 2]]), image([[3]])], gap: 1, value: 9)", &[1.0, 2.0, 9.0, 3.0, 9.0]),
    ("montage([image([[1], [2], [3]]), image([[4]])], columns: 1, gap: 0, value: 0)", &[1.0, 2.0, 3.0, 0.0, 4.0, 0.0]),
    (
        "montage([image([[[1, 2, 3]]]), image([[5]])], gap: 1, value: [7, 8, 9])",
        &[1.0, 2.0, 3.0, 7.0, 8.0, 9.0, 5.0, 5.0, 5.0],
    ),
    ("255 * to_srgb(colormap(image([[0, 1]])))", &[68.0, 1.0, 84.0, 253.0, 231.0, 37.0]),
    ("255 * to_srgb(colormap(image([[-9, 4]]), map: diverging, high: 3))", &[33.0, 60.0, 140.0, 123.0, 15.0, 38.0]),
    (
        "colormap(image([[-1, 0, 2]]), map: diverging)[0, 1] - colormap(image([[0, 1, 2]]), map: diverging, low: 0)[0, 1]",
        &[0.0; 3],
    ),
    ("colormap(image([[5, 5]])) - colormap(image([[0, 1, 2]]))[0, 1]", &[0.0; 6]),
    ("bounds(cube(size: [1, 2, 3]))", &[-0.5, -1.0, -1.5, 0.5, 1.0, 1.5]),
    ("surface_area(cube(size: [1, 2, 3]))", &[22.0]),
    ("volume(cube(size: [1, 2, 3]) |> translate([1e6, 0, 0]))", &[6.0]),
    ("volume(cube() |> flip())", &[-1.0]),
    ("centroid(rectangle() |> translate([1, 2, 3]))", &[1.0, 2.0, 3.0]),
    ("chamfer([[0, 0, 0], [2, 0, 0]], [[0, 0, 1]])", &[4.0]),
];

#[test]
fn values_are_as_declared() {
    on_large_stack(|| {
        let mut engine = engine();
        for (text, expected) in VALUES {
            let found = numbers(&mut engine, text);
            let near = found.len() == expected.len() && found.iter().zip(*expected).all(|(a, b)| (a - b).abs() < 1e-9);
            assert!(near, "{text} is {found:?}, not {expected:?}");
        }
    });
}

/// What is refused: by the checker (`true`) where it can be known, and a part of the message.
const REFUSED: &[(&str, bool, &str)] = &[
    ("2 @ [1, 2]", true, "`@` does not go with"),
    ("[[1, 2], [3, 4]] @ [1, 2, 3]", true, "`@` does not go with"),
    ("rotation(angle: turn) @ [1, 2]", true, "`@` does not go with"),
    ("[1, 2, 3] @ rotation(angle: turn)", true, "`@` does not go with"),
    ("rotation(angle: turn) * [1, 2, 3]", true, "`*` does not go with"),
    ("matrix(rotation(angle: turn)) * v", true, "element by element"),
    ("inverse([[1, 2], [2, 4]])", true, "no inverse"),
    ("inverse(n)", true, "square"),
    ("determinant(n)", true, "square"),
    ("rotation(axis: v)", true, "without an angle"),
    ("rotation(angle: turn, matrix: m)", true, "not from both"),
    ("rotation(matrix: [[1, 0, 0], [0, 0, 0], [0, 0, 0]])", true, "several are equally near"),
    ("quaternion(0, 0, 0, 0)", true, "not all 0"),
    ("rotation(six: [1, 0, 0, 2, 0, 0])", true, "different directions"),
    ("sum([1, 2], axis: 1)", true, "no axis 1"),
    ("sum(n, axis: [0, 0])", false, "twice"),
    ("max(v, w, axis: 0)", true, "along no axis"),
    ("mean(image(im), axis: 3)", true, "no axis 3"),
    ("median([])", true, "nothing"),
    ("max([])", true, "nothing"),
    ("percentile(v, 101)", true, "from 0 to 100"),
    ("mod(v, 0)", true, "by 0"),
    ("mod(v, 30deg)", true, "an angle and a number"),
    ("min(v, [1, 2])", true, "does not go with"),
    ("concat(image(im), v)", true, "images with images"),
    ("concat(image(im), crop(image(im), width: 2, height: 2))", true, "different widths"),
    ("concat(v)", true, "a list of arrays"),
    ("concat(v, 1)", true, "arrays with arrays"),
    ("stack([v, cube()])", true, "of one shape"),
    ("[] @ v", true, "`@` does not go with"),
    ("sort(\"text\")", true, "`x` of `sort`"),
    ("where(v > 0, n, 0)", true, "does not fit"),
    ("where(v > 0, cube(), cube())", true, "element by element"),
    ("if v > 0 then 1 else 2", true, "a condition is a `bool`"),
    ("concat(v, w, axis: 1)", true, "no axis 1"),
    ("pad(image(im), left: -1)", true, "from 0"),
    ("sample(image(im), [1, 2, 3])", true, "two coordinates"),
    ("image(im)[2, 0]", true, "index 2"),
    ("image(im)[0..1, 0]", true, "no elements to slice"),
    ("montage([photo, mask])", false, "do not go together"),
    ("montage([])", true, "no images"),
    ("colormap(photo)", true, "one channel"),
    ("colormap(mask, low: 1, high: 0.5)", true, "no length"),
    ("colormap(mask, low: 9)", false, "from 9 to 1"),
    ("volume(rectangle())", false, "closed"),
    ("chamfer([], v)", true, "`b`"),
    ("project(eye, [1, 2, 9])", false, "not in front"),
    ("project(eye, [1, 2])", true, "three coordinates"),
    // More memory than there is, whatever the operation makes of small operands.
    ("sum(reshape(0..3000000, [3000000, 1]) @ reshape(0..3000000, [1, 3000000]))", false, "of memory"),
    ("where(reshape(0..3000000, [3000000, 1]) > 1, reshape(0..3000000, [1, 3000000]), 0)", false, "of memory"),
    ("min(reshape(0..3000000, [3000000, 1]), reshape(0..3000000, [1, 3000000]))", false, "of memory"),
];

#[test]
fn what_has_no_answer_is_refused() {
    on_large_stack(|| {
        let mut engine = engine();
        let mut wrong = Vec::new();
        for (text, by_checker, message) in REFUSED {
            match fault(&mut engine, text) {
                None => wrong.push(format!("{text} is not refused")),
                Some((early, d)) if early != *by_checker || !d.message.contains(message) => {
                    wrong.push(format!("{text}: {early} {}", d.message));
                }
                Some(_) => {}
            }
        }
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    });
}

#[test]
fn derivatives_have_derivatives() {
    on_large_stack(|| {
        let mut engine = engine();
        for (of, wrt) in [
            ("matrix(rotation(matrix: m))", "m"),
            ("matrix(rotation(six: six))", "six"),
            ("matrix(rotation(quaternion: four))", "four"),
            ("inverse(m)", "m"),
            ("determinant(m)", "m"),
            ("variance(n, axis: 0)", "n"),
            ("sample(image(im), n / 3 + [0.3, 0.6])", "n"),
            ("volume(body)", "points"),
            ("chamfer(points, icosphere(subdivisions: 0))", "points"),
        ] {
            let slope = format!("sum(grad(sum(({of} + 0.3) ^ 3), {wrt}) ^ 2)");
            let found = numbers(&mut engine, &format!("grad({slope}, {wrt})"));
            let differences = numbers(&mut engine, &format!("fd({slope}, {wrt}, step: 1e-5)"));
            let size = differences.iter().fold(1e-3f64, |s, x| s.max(x.abs()));
            let near = found.iter().zip(&differences).all(|(a, b)| (a - b).abs() <= 1e-5 * size);
            assert!(near && found.len() == differences.len(), "{of}: {found:?}, differences {differences:?}");
        }
    });
}

#[test]
fn the_nearest_rotation_is_the_nearest() {
    on_large_stack(|| {
        let mut engine = engine();
        // General, near to singular, and mirroring.
        for m in ["m", "m + [[0, 0, 0], [0, 0, 0], [0, 0, 2]]", "-m", "[[1, 2, 3], [2, 4, 6], [1, 0, 1]]"] {
            let distance = |r: &str| format!("norm({m} - matrix({r}))");
            let nearest = format!("rotation(matrix: {m})");
            let least = numbers(&mut engine, &distance(&nearest))[0];
            for axis in ["[1, 0, 0]", "[0, 1, 0]", "[0, 0, 1]", "[1, 1, -1]"] {
                for angle in ["1deg", "-1deg", "40deg", "180deg"] {
                    let other =
                        numbers(&mut engine, &distance(&format!("rotation(axis: {axis}, angle: {angle}) @ {nearest}")));
                    assert!(other[0] > least, "{m}: {} is not farther than {least}", other[0]);
                }
            }
        }
    });
}

/// Of two pairs of pictures, one of noise and one of waves, at two distances; as the program that goes with the paper says (which computes
/// in single precision).
#[test]
fn flip_error_is_that_of_its_authors() {
    let picture = |value: &str| format!("image([[[{value} for c in 0..3] for x in 0..24] for y in 0..20])");
    let noise = ["mod(7 * x + 3 * y + 5 * c, 11) / 10", "mod(5 * x + 2 * y * y + 3 * c, 13) / 12"].map(picture);
    let waves = ["0.5 + 0.4 * sin((x / 5 + c) * 1rad)", "0.5 + 0.4 * sin((x / 5 + c + 0.02 * y) * 1rad)"].map(picture);
    on_large_stack(|| {
        let mut engine = engine();
        for ([a, b], at, wanted) in
            [(&noise, 67.02, 0.278388), (&noise, 20.0, 0.824297), (&waves, 67.02, 0.271974), (&waves, 20.0, 0.256074)]
        {
            let found = numbers(&mut engine, &format!("flip_error({b}, {a}, pixels_per_degree: {at})"))[0];
            assert!((found - wanted).abs() < 1e-4, "{found} {wanted}");
        }
        assert_eq!(numbers(&mut engine, &format!("flip_error({0}, {0})", waves[0])), [0.0]);
        let [a, b] = &noise;
        let map = numbers(&mut engine, &format!("flip_map({b}, {a})"));
        let left = "image([[[if x < 12 then 1 else 0] for x in 0..24] for y in 0..20])";
        let found = numbers(&mut engine, &format!("flip_error({b}, {a}, weight: {left})"))[0];
        let wanted = (0..480).filter(|i| i % 24 < 12).map(|i| map[i]).sum::<f64>() / 240.0;
        assert!(map.len() == 480 && (found - wanted).abs() < 1e-9, "{found} {wanted}");
    });
}
