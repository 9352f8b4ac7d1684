//! Adjoints of mesh and image operations against central differences, and what natives refuse.

use std::sync::Arc;

use super::value::{MeshValue, Value};
use super::*;
use crate::stop::{self, Stopped};
use crate::tape::{Tensor, Var, backward_with, forward};

fn context() -> Context {
    Context {
        base_dir: PathBuf::from("."),
        seed: 0,
        step: 0,
        losses: Default::default(),
        squares: Default::default(),
        warnings: Default::default(),
    }
}

fn call(name: &str, args: &[(&str, Value)]) -> Result<Value> {
    let names: Vec<&str> = args.iter().map(|a| a.0).collect();
    let values: Vec<Value> = args.iter().map(|a| a.1.clone()).collect();
    find(name).expect("a native")(&Args { names: &names, values: &values, context: &context() })
}

fn vector(x: &[f64]) -> Value {
    Value::tensor(Tensor::vector(x.to_vec()))
}

/// Numbers in (−1, 1), the same at every run.
fn numbers(shape: &[usize], seed: u64) -> Tensor {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let n: usize = shape.iter().product();
    let next = |_| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    Tensor::new(shape.to_vec(), (0..n).map(next).collect())
}

/// ⟨Jv, w⟩ = ⟨v, Jᵀw⟩ and both agree with central differences.
fn check(name: &str, x: &Tensor, f: impl Fn(Var) -> Var) {
    let leaf = Var::leaf(x.clone());
    let y = f(leaf.clone());
    let (w, v) = (numbers(y.shape(), 5), numbers(&x.shape, 6));
    let reverse = backward_with(&y, w.clone(), std::slice::from_ref(&leaf)).unwrap()[0].dot(&v);
    let tangent = forward(&y, &[(leaf, v.clone())]).unwrap().dot(&w);
    let h = 1e-5;
    let at = |s: f64| {
        let mut moved = x.clone();
        moved.accumulate(&v.scaled(s));
        f(Var::constant(moved)).value().dot(&w)
    };
    let fd = (at(h) - at(-h)) / (2.0 * h);
    assert!((reverse - tangent).abs() < 1e-9 * (1.0 + tangent.abs()), "{name}: reverse {reverse}, forward {tangent}");
    assert!((reverse - fd).abs() < 1e-5 * (1.0 + fd.abs()), "{name}: reverse {reverse}, differences {fd}");
}

/// All numbers of a mesh in one vector.
fn all(mesh: &Value) -> Var {
    let Value::Mesh(m) = mesh else { panic!("not a mesh") };
    let mut parts = vec![m.vertices.reshape(vec![m.vertices.len()]).unwrap()];
    if let Some(n) = &m.normals {
        parts.push(n.reshape(vec![n.len()]).unwrap());
    }
    Var::concat(&parts, 0).unwrap()
}

fn ball() -> MeshValue {
    let Ok(Value::Mesh(m)) = call("icosphere", &[("radius", Value::scalar(1.3)), ("subdivisions", Value::scalar(0.0))])
    else {
        panic!("no sphere")
    };
    let bent = m.vertices.add(&Var::constant(numbers(m.vertices.shape(), 3).scaled(0.1))).unwrap();
    MeshValue { vertices: bent, ..(*m).clone() }
}

#[test]
fn mesh_operations_carry_derivatives_of_vertices_and_normals() {
    let ball = ball();
    let x = ball.vertices.value().clone();
    let with = |v: Var| Value::Mesh(Arc::new(MeshValue { vertices: v, ..ball.clone() }));
    let steps: [(&str, Vec<(&str, Value)>); 9] = [
        ("translate", vec![("offset", vector(&[1.0, 2.0, 3.0]))]),
        ("rotate", vec![("x", Value::scalar(0.3)), ("y", Value::scalar(-1.0))]),
        ("scale", vec![("factor", vector(&[1.0, -2.0, 0.5]))]),
        ("flip", vec![]),
        ("smooth_normals", vec![]),
        ("subdivide", vec![("levels", Value::scalar(1.0))]),
        ("center", vec![]),
        ("normalize", vec![]),
        ("merge", vec![("b", Value::Mesh(Arc::new(ball.clone())))]),
    ];
    for (name, more) in steps {
        check(name, &x, |v| {
            let mut args = vec![("mesh", with(v))];
            args.extend(more.iter().cloned());
            all(&call(name, &args).unwrap())
        });
    }
    for name in ["laplacian_energy", "edge_length_energy", "normal_consistency", "bending_energy"] {
        check(name, &x, |v| call(name, &[("mesh", with(v))]).unwrap().var().unwrap().clone());
    }
}

#[test]
fn transforms_carry_derivatives_of_their_numbers() {
    let mesh = || Value::Mesh(Arc::new(ball()));
    check("offset", &numbers(&[3], 1), |v| {
        all(&call("translate", &[("mesh", mesh()), ("offset", Value::Num(v))]).unwrap())
    });
    check("factor", &numbers(&[3], 1).map(|x| x + 2.0), |v| {
        all(&call("scale", &[("mesh", mesh()), ("factor", Value::Num(v))]).unwrap())
    });
    check("angle", &Tensor::scalar(0.4), |v| {
        let args = [("mesh", mesh()), ("axis", vector(&[1.0, 1.0, 0.0])), ("angle", Value::Num(v))];
        all(&call("rotate", &args).unwrap())
    });
    check("matrix", &numbers(&[3, 3], 4), |v| {
        all(&call("transform", &[("mesh", mesh()), ("by", Value::Num(v))]).unwrap())
    });
    for name in ["cylinder", "cone"] {
        check(name, &Tensor::scalar(0.8), |v| {
            all(&call(name, &[("radius", Value::Num(v.clone())), ("height", Value::Num(v.scale(3.0)))]).unwrap())
        });
    }
    check("torus", &Tensor::scalar(0.3), |v| {
        all(&call(
            "torus",
            &[("radius", Value::scalar(2.0)), ("tube", Value::Num(v)), ("subdivisions", Value::scalar(5.0))],
        )
        .unwrap())
    });
    check("heightfield", &numbers(&[3, 4], 2), |v| all(&call("heightfield", &[("heights", Value::Num(v))]).unwrap()));
    check("look_at", &numbers(&[3], 8), |v| {
        let args = [("position", Value::Num(v)), ("target", vector(&[2.0, 1.0, 0.5]))];
        call("look_at", &args).unwrap().var().unwrap().clone()
    });
}

#[test]
fn image_operations_carry_derivatives() {
    let x = numbers(&[6, 5, 3], 1);
    let one = |name: &'static str, more: Vec<(&'static str, Value)>| {
        check(name, &x, |v| {
            let mut args = vec![("image", Value::Image(v))];
            args.extend(more.iter().cloned());
            match call(name, &args).unwrap() {
                Value::List(levels) => levels.last().unwrap().var().unwrap().clone(),
                other => other.var().unwrap().clone(),
            }
        });
    };
    one("blur", vec![("sigma", Value::scalar(0.8))]);
    one("resize", vec![("width", Value::scalar(3.0)), ("height", Value::scalar(9.0))]);
    one("downsample", vec![("factor", Value::scalar(4.0))]);
    one("pyramid", vec![("levels", Value::scalar(3.0))]);
    one("crop", vec![("x", Value::scalar(1.0)), ("y", Value::scalar(2.0)), ("width", Value::scalar(3.0))]);
    one("flip", vec![]);
    one("luminance", vec![]);
    one("gradient", vec![]);
}

#[test]
fn a_rigid_motion_turns_normals_and_a_stretch_keeps_them_perpendicular() {
    let square = call("rectangle", &[("width", Value::scalar(2.0)), ("depth", Value::scalar(2.0))]).unwrap();
    let square = call("smooth_normals", &[("mesh", square)]).unwrap();
    let tilted = call("rotate", &[("mesh", square), ("z", Value::scalar(0.5))]).unwrap();
    let stretched = call("scale", &[("mesh", tilted), ("factor", vector(&[3.0, 1.0, 1.0]))]).unwrap();
    let Value::Mesh(m) = &stretched else { panic!("not a mesh") };
    let mesh = m.to_mesh();
    let face = mesh.faces[0].map(|i| mesh.vertices[i as usize]);
    let normal = (face[1] - face[0]).cross(face[2] - face[0]).normalize();
    assert!((normal - mesh.normals.unwrap()[0]).length() < 1e-5);
}

#[test]
fn bad_arguments_are_blamed() {
    let blame =
        |name: &str, args: &[(&str, Value)]| call(name, args).err().map(|e| (e.arg, e.message)).expect("an error");
    let faces = Value::tensor(Tensor::rows([[0.0, 1.0, 7.0]]));
    let points = Value::tensor(Tensor::rows([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]));
    assert_eq!(blame("mesh", &[("vertices", points.clone()), ("faces", faces)]).0, Some(1));
    let holed = Value::tensor(Tensor::rows([[0.0; 3], [f64::NAN, 0.0, 0.0], [0.0, 1.0, 0.0]]));
    let good = Value::tensor(Tensor::rows([[0.0, 1.0, 2.0]]));
    assert_eq!(blame("mesh", &[("vertices", holed), ("faces", good)]).0, Some(0));
    assert_eq!(blame("sphere", &[("radius", Value::scalar(-1.0))]).0, Some(0));
    assert_eq!(blame("scale", &[("mesh", Value::Mesh(Arc::new(ball()))), ("factor", Value::scalar(0.0))]).0, Some(1));
    assert_eq!(blame("load", &[("path", Value::str("no/such/file.obj"))]).0, Some(0));
    assert_eq!(blame("load_image", &[("path", Value::str("no/such/file.png"))]).0, Some(0));
    assert_eq!(blame("diffuse", &[("reflectance", Value::scalar(-0.5))]).0, Some(0));
    let rough = [("diffuse", Value::scalar(0.5)), ("specular", Value::scalar(0.5)), ("roughness", Value::scalar(-1.0))];
    assert_eq!(blame("phong", &rough).0, Some(2));
    assert_eq!(blame("sqrt", &[("x", Value::scalar(-1.0))]).0, Some(0));
    let film = |w: f64, h: f64| [("film", vector(&[w, h]))];
    assert_eq!(blame("camera", &film(0.0, 4.0)).0, Some(0));
    assert_eq!(blame("camera", &film(1e5, 1e5)).0, Some(0));
    assert_eq!(blame("camera", &[("fov", Value::scalar(0.0))]).0, Some(0));
    assert_eq!(blame("camera", &[("fov", Value::scalar(std::f64::consts::PI))]).0, Some(0));
    let same = [("position", vector(&[1.0; 3])), ("look_at", vector(&[1.0; 3]))];
    assert_eq!(blame("camera", &same).0, Some(1));
    assert_eq!(blame("zip", &[("a", vector(&[1.0])), ("b", vector(&[1.0, 2.0]))]).0, Some(1));
}

#[test]
fn fields_can_be_read_and_replaced() {
    let disk = call("disk", &[("radius", Value::scalar(1.0))]).unwrap();
    let lamp = call("area", &[("mesh", disk), ("radiance", Value::scalar(3.0))]).unwrap();
    assert_eq!(field(&lamp, "radiance").unwrap().number(), Some(3.0));
    let path = ["radiance".to_string()];
    let brighter = set_field(&lamp, &path, Value::scalar(5.0)).unwrap();
    assert_eq!(field(&brighter, "radiance").unwrap().number(), Some(5.0));
    assert!(set_field(&lamp, &["power".to_string()], Value::scalar(5.0)).is_err());
    let v = set_field(&vector(&[1.0, 2.0, 3.0]), &["zx".to_string()], vector(&[7.0, 8.0])).unwrap();
    assert_eq!(v.var().unwrap().value().data, [8.0, 2.0, 7.0]);
    assert_eq!(field(&v, "y").unwrap().number(), Some(2.0));
    assert_eq!(field(&v, "bgr").unwrap().var().unwrap().value().data, [7.0, 2.0, 8.0]);
    assert!(field(&v, "w").is_none());
}

#[test]
fn no_name_is_implemented_twice() {
    let mut seen = std::collections::HashSet::new();
    for name in names() {
        assert!(seen.insert(name), "{name}");
    }
}

#[test]
fn long_natives_check_as_they_go() {
    let image = |w: usize, h: usize| Value::Image(Var::constant(numbers(&[h, w, 1], 1)));
    let matrix = |n: usize| Value::tensor(numbers(&[n, n], 2));
    let points = |n: usize| Value::tensor(numbers(&[n, 3], 3));
    let ball = |n: f64| call("sphere", &[("radius", Value::scalar(1.0)), ("subdivisions", Value::scalar(n))]).unwrap();
    let number = |(name, x): (&'static str, f64)| (name, Value::scalar(x));
    let size = |n: f64| [("width", Value::scalar(n)), ("height", Value::scalar(n))];
    // With how many elements are worked on at least; a check comes after some 65536 of them.
    type Case = (&'static str, Vec<(&'static str, Value)>, u64);
    let cases: Vec<Case> = vec![
        ("blur", vec![("image", image(300, 300)), ("sigma", Value::scalar(1e3))], 2 * 300 * 300 * 300),
        ("resize", [vec![("image", image(100, 100))], size(2000.0).to_vec()].concat(), 2 * 2000 * 2000),
        ("sort", vec![("x", vector(&numbers(&[300_000], 4).data))], 10 * 300_000),
        ("inverse", vec![("x", matrix(200))], 200 * 200 * 200),
        ("chamfer", vec![("a", points(60_000)), ("b", points(60_000))], 60_000),
        ("subdivide", vec![("mesh", ball(64.0)), ("levels", Value::scalar(3.0))], 16 * 64 * 64 * 2 * 20),
        ("smooth_normals", vec![("mesh", ball(400.0))], 8 * 400 * 400),
        ("laplacian_energy", vec![("mesh", ball(400.0))], 16 * 400 * 400),
        ("sphere", [("radius", 1.0), ("subdivisions", 300.0)].map(number).to_vec(), 8 * 2 * 300 * 300),
        ("torus", vec![number(("subdivisions", 600.0))], 8 * 600 * 600),
        ("icosphere", vec![number(("subdivisions", 7.0))], 10 * 4 * 4 * 4 * 4 * 4 * 4 * 4 * 8),
        ("disk", [("radius", 1.0), ("subdivisions", 60_000.0)].map(number).to_vec(), 8 * 60_000),
        ("sin", vec![("x", Value::tensor(numbers(&[3_000_000], 5)))], 700_000),
        ("noise", vec![("shape", Value::scalar(700_000.0))], 700_000),
        ("uniform", vec![("shape", Value::scalar(700_000.0))], 700_000),
        ("minibatch", [("items", vector(&numbers(&[300_000], 6).data)), ("count", Value::scalar(3e5))].into(), 600_000),
        (
            "clear_sky",
            vec![("sun", vector(&[1.0, 1.0, 0.0])), number(("turbidity", 3.0)), number(("width", 512.0))],
            3 * 512 * 256 * 2,
        ),
        ("montage", vec![("images", Value::list(vec![image(300, 200); 20]))], 20 * 300 * 200 * 2),
        ("colormap", vec![("image", image(700, 500))], 700 * 500 * 6),
        ("pad", vec![("image", image(700, 500)), ("left", Value::scalar(600.0))], 1300 * 500),
        ("sample", vec![("image", image(700, 500)), ("uv", Value::tensor(numbers(&[200_000, 2], 7)))], 4 * 200_000),
        ("concat", vec![("a", image(600, 700)), ("b", image(600, 700)), number(("axis", 1.0))], 2 * 600 * 700),
        ("stack", vec![("items", Value::list(vec![image(300, 200); 20]))], 1_200_000),
    ];
    for (name, args, work) in cases {
        let before = stop::checks();
        call(name, &args).unwrap();
        let checks = stop::checks() - before;
        assert!(checks > work / (1 << 17), "{name}: {checks} checks");
        let set = Arc::new(true.into());
        assert_eq!(stop::until(&set, || call(name, &args).map(|_| ())), Err(Stopped), "{name}");
    }
    let product = |x: &Value| apply(x, x).map(|_| ());
    let before = stop::checks();
    product(&matrix(200)).unwrap();
    assert!(stop::checks() - before > 200 * 200 * 200 / (1 << 17));
}

#[test]
fn files_are_read_apart() {
    let folder = tempfile::tempdir().unwrap();
    let set = Arc::new(true.into());
    for (name, file) in [
        ("load", "a.obj"),
        ("load_scene", "a.gltf"),
        ("load_cameras", "a.glb"),
        ("load_image", "a.exr"),
        ("texture", "a.png"),
        ("load_json", "a.json"),
        ("load_table", "a.csv"),
        ("load_array", "a.npy"),
    ] {
        let path = Value::str(folder.path().join(file).display().to_string());
        assert_eq!(stop::until(&set, || call(name, &[("path", path.clone())]).map(|_| ())), Err(Stopped), "{name}");
        assert!(call(name, &[("path", path)]).is_err(), "{name}");
    }
    let network = || call("load_network", &[("weights", Value::str("a.safetensors")), ("layers", Value::str("vgg16"))]);
    assert_eq!(stop::until(&set, || network().map(|_| ())), Err(Stopped));
    assert!(network().is_err());
}

#[test]
fn three_sheets_that_meet_in_an_edge_have_no_volume() {
    // Three cones over one triangle: each of its edges belongs to a face of every cone.
    let vertices =
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0], [0.0, -1.0, 0.0]];
    let cone = |apex: u32| (0..3).map(move |i| [i, (i + 1) % 3, apex]);
    let mesh = crate::mesh::Mesh {
        vertices: vertices.map(glam::Vec3::from_array).to_vec(),
        faces: (3..6).flat_map(cone).collect(),
        ..Default::default()
    };
    let mesh = Value::Mesh(Arc::new(MeshValue::from(&mesh)));
    let Err(error) = call("volume", &[("mesh", mesh)]) else { panic!("it has a volume") };
    assert!(error.message.contains("3 edges belong to an odd number of faces"), "{}", error.message);
}

#[test]
fn a_nan_has_no_place_among_numbers() {
    for name in ["sort", "argmin", "argmax"] {
        assert!(call(name, &[("x", vector(&[2.0, 1.0]))]).is_ok(), "{name}");
        let told = call(name, &[("x", vector(&[2.0, f64::NAN, 1.0]))]).map(|_| ()).unwrap_err();
        assert!(told.message.contains("NaN") && told.arg == Some(0), "{name}: {}", told.message);
    }
    for (x, y) in [(f64::NAN, 0.0), (1.0, f64::NAN), (f64::NAN, 2.0)] {
        let found = call("median", &[("x", vector(&[x, y, 3.0]))]).unwrap();
        assert!(found.number().unwrap().is_nan());
        assert!(crate::tape::Binary::Pow.value(x, y).is_nan(), "{x} ^ {y}");
    }
}
