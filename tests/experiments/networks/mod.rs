//! Networks with fixed weights: scores against plain loops in double precision, derivatives in both modes, files of all kinds.

mod fetched;
mod plain;

use std::fmt::Write;

use dscene::check::{Checked, Disk, Line, check_line, check_text};
use dscene::data::npy;
use dscene::data::safetensors::{self, encode};
use dscene::diag::{Diagnostic, RenderOptions, render};
use dscene::eval::value::Value;
use dscene::eval::{Engine, EngineOptions, on_large_stack};
use dscene::network::{Description, Fault, Network, SHIPPED};
use dscene::tape::Tensor;
use plain::{activations, reference};
use serde_json::{Value as Json, json};

/// Numbers that look random, from −1 to 1.
fn noise(n: usize, seed: u64) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as f64 / (1u64 << 30) as f64 - 1.0
    };
    (0..n).map(|_| next()).collect()
}

type Weights = Vec<(String, Tensor)>;

/// A picture in the middle of its range, where nothing is cut off.
fn picture(height: usize, width: usize, seed: u64) -> Vec<f64> {
    noise(height * width * 3, seed).into_iter().map(|x| 0.4 + 0.35 * x).collect()
}

fn array(name: &str, shape: &[usize], size: f64) -> (String, Tensor) {
    let seed = name.bytes().fold(shape.len() as u64, |h, b| h.wrapping_mul(31).wrapping_add(u64::from(b)));
    let data = noise(shape.iter().product(), seed).into_iter().map(|x| f64::from((size * x) as f32)).collect();
    (name.to_owned(), Tensor { shape: shape.to_vec(), data })
}

/// Batch normalisation with variances above 0.
fn norm(name: &str, channels: usize) -> Weights {
    let part = |part: &str, size: f64| array(&format!("{name}.{part}"), &[channels], size);
    let mut all = vec![part("weight", 0.5), part("bias", 0.3), part("running_mean", 0.4), part("running_var", 0.5)];
    all[0].1.data.iter_mut().for_each(|x| *x += 1.0);
    all[3].1.data.iter_mut().for_each(|x| *x += 1.0);
    all
}

fn file(weights: &Weights) -> Vec<u8> {
    encode(weights.iter().map(|(name, array)| (name.as_str(), array)))
}

fn network(description: &Json, weights: &Weights) -> Result<Network, Fault> {
    let description = Description::parse(&description.to_string()).map_err(Fault::Description)?;
    Network::new(description, &safetensors::decode(file(weights)).map_err(Fault::Weights)?)
}

fn input(height: usize, width: usize, channels: &str) -> Json {
    json!({ "width": width, "height": height, "channels": channels, "range": 255,
            "mean": [127, 120, 110], "std": [128, 60, 70] })
}

fn described(input: Json, layers: Json) -> Json {
    json!({ "about": "a test", "input": input, "epsilon": 1e-3, "layers": layers })
}

/// A name, a description and its weights: all kinds of layers, with odd sizes, strides, groups and links.
fn networks() -> Vec<(&'static str, Json, Weights)> {
    let conv =
        |name: &str, shape: [usize; 4]| array(&format!("{name}.weight"), &shape, 1.0 / (shape[1] * shape[2]) as f64);
    let dense =
        |name: &str, shape: [usize; 2]| array(&format!("{name}.weight"), &shape, 1.0 / (shape[1] as f64).sqrt());
    let bias = |name: &str, n: usize| array(&format!("{name}.bias"), &[n], 0.4);
    let residual = described(
        input(19, 23, "rgb"),
        json!([
            { "kind": "conv", "name": "stem", "stride": 2, "padding": "same", "norm": "n0", "activation": "relu6", "label": "in" },
            { "kind": "conv", "name": "wide", "norm": "n1", "activation": "relu6" },
            { "kind": "conv", "name": "deep", "padding": "same", "groups": 12, "norm": "n2", "activation": "relu6" },
            { "kind": "conv", "name": "thin", "norm": "n3" },
            { "kind": "add", "with": "in", "label": "sum", "activation": "relu" },
            { "kind": "conv", "name": "down", "stride": [3, 2], "padding": "same", "groups": 6, "label": "main" },
            { "kind": "conv", "name": "short", "from": "sum", "stride": [3, 2], "label": "side" },
            { "kind": "add", "from": "main", "with": "side", "activation": "relu" },
            { "kind": "mean_pool" },
            { "kind": "linear", "name": "fc" }
        ]),
    );
    let mut weights = vec![
        conv("stem", [6, 3, 3, 3]),
        conv("wide", [12, 6, 1, 1]),
        conv("deep", [12, 1, 5, 5]),
        conv("thin", [6, 12, 1, 1]),
        conv("down", [6, 1, 3, 3]),
        conv("short", [6, 6, 1, 1]),
        dense("fc", [7, 6]),
        bias("fc", 7),
    ];
    weights.extend([("n0", 6), ("n1", 12), ("n2", 12), ("n3", 6)].into_iter().flat_map(|(name, n)| norm(name, n)));
    let plain = described(
        input(21, 14, "bgr"),
        json!([
            { "kind": "conv", "name": "a", "padding": [2, 1], "dilation": [2, 1], "activation": "relu" },
            { "kind": "max_pool", "size": 3, "stride": 2, "padding": 1 },
            { "kind": "conv", "name": "b", "groups": 2, "stride": 2, "padding": 3 },
            { "kind": "norm", "name": "n", "activation": "relu" },
            { "kind": "mean_pool", "size": [2, 3], "stride": [1, 2], "padding": "same" },
            { "kind": "max_pool", "size": 2, "padding": "same" },
            { "kind": "linear", "name": "c", "norm": "m", "activation": "relu" },
            { "kind": "linear", "name": "d" }
        ]),
    );
    let mut others = vec![
        conv("a", [8, 3, 3, 3]),
        bias("a", 8),
        // A multiplier of 2: groups of several outputs.
        conv("b", [16, 4, 4, 5]),
        bias("b", 16),
        dense("c", [300, 128]),
        dense("d", [5, 300]),
        bias("d", 5),
    ];
    others.extend(norm("n", 16).into_iter().chain(norm("m", 300)));
    vec![("residual", residual, weights), ("plain", plain, others)]
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn sizes(description: &Json) -> (usize, usize) {
    let side = |key: &str| description["input"][key].as_u64().unwrap() as usize;
    (side("height"), side("width"))
}

#[test]
fn scores_are_those_of_plain_loops() {
    for (name, description, weights) in networks() {
        let network = network(&description, &weights).unwrap();
        let (height, width) = sizes(&description);
        for seed in 1..4 {
            let mut picture = picture(height, width, seed);
            // Beyond 0 and 1 it is cut off.
            picture[5] = -0.5;
            picture[9] = 7.0;
            let (found, wanted) = (network.value(&picture).unwrap().0, reference(&description, &weights, &picture));
            assert_eq!(found.len(), network.classes());
            let size = wanted.iter().fold(0.1f64, |s, x| s.max(x.abs()));
            let near = found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 2e-5 * size);
            assert!(near, "{name}: {found:?} and {wanted:?}");
        }
    }
}

/// The distance of directions, pixel by pixel, in the last activations of each size.
#[test]
fn perceptual_errors_are_those_of_plain_loops() {
    on_large_stack(|| {
        let script = Script::new();
        let (_, description, weights) = networks().swap_remove(0);
        let (height, width) = sizes(&description);
        let pictures = [1, 2].map(|seed| picture(height, width, seed));
        let [a, b] = pictures.each_ref().map(|picture| activations(&description, &weights, picture));
        let mut wanted = 0.0;
        // Sizes are those of the stem, up to the sum, and of what comes after the stride; a mean of one pixel is none.
        let last =
            |k: usize| a.get(k + 1).is_none_or(|next| next.size[1..] != a[k].size[1..]) && a[k].size[1..] != [1, 1];
        let mut layers = 0;
        for (a, b) in a.iter().zip(&b).enumerate().filter(|(k, _)| last(*k)).map(|(_, pair)| pair) {
            let pixels = a.size[1] * a.size[2];
            for pixel in 0..pixels {
                let [a, b] =
                    [a, b].map(|map| (0..map.size[0]).map(|c| map.data[c * pixels + pixel]).collect::<Vec<f64>>());
                let (of_a, of_b) = (dot(&a, &a).sqrt() + 1e-10, dot(&b, &b).sqrt() + 1e-10);
                wanted += a.iter().zip(&b).map(|(a, b)| (a / of_a - b / of_b).powi(2)).sum::<f64>() / pixels as f64;
            }
            layers += 1;
        }
        assert!(layers >= 2 && wanted > 0.0);
        for (name, picture) in ["a", "b"].into_iter().zip(pictures) {
            let data = Tensor { shape: vec![height, width, 3], data: picture };
            std::fs::write(script.folder.path().join(format!("{name}.npy")), npy::encode(&data)).unwrap();
        }
        let text = "let net = load_network(\"net.safetensors\", layers: \"net.json\")\n\
            let a = image(load_array(\"a.npy\"))\nlet b = image(load_array(\"b.npy\"))\n";
        let numbers = |result: &str| script.numbers(&format!("{text}let result = {result}"));
        let found = numbers("[perceptual_error(net, a, b), perceptual_error(net, b, a), perceptual_error(net, a, a)]");
        assert!((found[0] / wanted - 1.0).abs() < 1e-4, "{found:?} {wanted}");
        assert!((found[0] - found[1]).abs() < 1e-12 && found[2] == 0.0);
        let (why, _) = script
            .result(&format!("{text}let result = perceptual_error(net, a, crop(b, width: 9, height: 9))"))
            .err()
            .unwrap();
        assert!(why.contains("not of one size"), "{why}");
    });
}

/// Differences are those of the plain loops, because single precision has too few digits for them.
#[test]
fn derivatives_are_those_of_plain_loops() {
    for (name, description, weights) in networks() {
        let network = network(&description, &weights).unwrap();
        let (height, width) = sizes(&description);
        let picture = picture(height, width, 5);
        let (scores, trace) = network.value(&picture).unwrap();
        let adjoint = noise(scores.len(), 8);
        let gradient = network.adjoint(&trace, &adjoint).unwrap();
        for seed in 20..28 {
            let direction = noise(picture.len(), seed);
            let tangent = network.tangent(&trace, &direction).unwrap();
            // ⟨u, J v⟩ = ⟨Jᵀ u, v⟩
            let (forward, backward) = (dot(&adjoint, &tangent), dot(&gradient, &direction));
            let size = adjoint.iter().zip(&tangent).map(|(a, b)| (a * b).abs()).sum::<f64>();
            assert!((forward - backward).abs() < 1e-5 * size, "{name}: forward {forward}, reverse {backward}");
            let h = 1e-7;
            let moved = |by: f64| {
                let moved: Vec<f64> = picture.iter().zip(&direction).map(|(x, t)| x + by * t).collect();
                reference(&description, &weights, &moved)
            };
            let (up, down) = (moved(h), moved(-h));
            for ((up, down), found) in up.iter().zip(&down).zip(&tangent) {
                let wanted = (up - down) / (2.0 * h);
                assert!((wanted - found).abs() < 1e-4 * size.max(wanted.abs()), "{name}: {found} and {wanted}");
            }
        }
        // Pixel by pixel, some of them.
        let size = gradient.iter().fold(0.0f64, |s, x| s.max(x.abs()));
        for i in (0..picture.len()).step_by(53) {
            let mut unit = vec![0.0; picture.len()];
            unit[i] = 1.0;
            let column = dot(&network.tangent(&trace, &unit).unwrap(), &adjoint);
            assert!((column - gradient[i]).abs() < 1e-4 * size, "{name}, number {i}: {column} and {}", gradient[i]);
        }
    }
}

#[test]
fn what_is_cut_off_has_no_derivative() {
    let (_, description, weights) = networks().swap_remove(0);
    let network = network(&description, &weights).unwrap();
    let mut picture = picture(19, 23, 3);
    (picture[100], picture[101], picture[102], picture[103]) = (-0.01, 0.0, 1.0, 1.01);
    let (scores, trace) = network.value(&picture).unwrap();
    let gradient = network.adjoint(&trace, &noise(scores.len(), 1)).unwrap();
    assert!(gradient[100] == 0.0 && gradient[103] == 0.0 && gradient[101] != 0.0 && gradient[102] != 0.0);
    // What is not a number stays so.
    picture[50] = f64::NAN;
    assert!(network.value(&picture).unwrap().0.iter().all(|x| x.is_nan()));
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    for (name, description, weights) in networks() {
        let network = network(&description, &weights).unwrap();
        let (height, width) = sizes(&description);
        let picture = picture(height, width, 9);
        let bits = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let (scores, trace) = network.value(&picture).unwrap();
                let gradient = network.adjoint(&trace, &noise(scores.len(), 1)).unwrap();
                scores.iter().chain(&gradient).map(|x| x.to_bits()).collect::<Vec<u64>>()
            })
        };
        assert_eq!(bits(1), bits(3), "{name}");
    }
}

/// VGG-16 as the library describes it, with every layer as narrow as `shrink` says: the same code, in less time.
#[test]
fn vgg16_has_the_layout_of_torchvision() {
    let convs: [(usize, usize, usize); 13] = [
        (0, 3, 64),
        (2, 64, 64),
        (5, 64, 128),
        (7, 128, 128),
        (10, 128, 256),
        (12, 256, 256),
        (14, 256, 256),
        (17, 256, 512),
        (19, 512, 512),
        (21, 512, 512),
        (24, 512, 512),
        (26, 512, 512),
        (28, 512, 512),
    ];
    let linears = [(0, 25088, 4096), (3, 4096, 4096), (6, 4096, 1000)];
    let (_, text) = SHIPPED.into_iter().find(|(name, _)| *name == "vgg16").unwrap();
    // The layers that have weights, by name, in the order of the file.
    let description: Json = serde_json::from_str(text).unwrap();
    let named = description["layers"].as_array().unwrap().iter().filter_map(|l| l["name"].as_str());
    let wanted = convs.iter().map(|(i, ..)| format!("features.{i}"));
    let wanted: Vec<String> = wanted.chain(linears.iter().map(|(i, ..)| format!("classifier.{i}"))).collect();
    assert_eq!(named.collect::<Vec<_>>(), wanted);
    let weights = |shrink: usize| {
        let narrow = |n: usize| if n == 3 || n == 1000 { n } else { n / shrink };
        let mut all = Weights::new();
        for (i, from, to) in convs {
            let (from, to) = (narrow(from), narrow(to));
            all.push(array(&format!("features.{i}.weight"), &[to, from, 3, 3], 0.8 / (from as f64).sqrt()));
            all.push(array(&format!("features.{i}.bias"), &[to], 0.1));
        }
        for (i, from, to) in linears {
            let (from, to) = (narrow(from), narrow(to));
            all.push(array(&format!("classifier.{i}.weight"), &[to, from], 2.0 / (from as f64).sqrt()));
            all.push(array(&format!("classifier.{i}.bias"), &[to], 0.1));
        }
        all
    };
    let narrow = weights(16);
    let network = network(&description, &narrow).unwrap();
    assert_eq!((network.picture(), network.classes()), ((224, 224), 1000));
    let picture = picture(224, 224, 2);
    let (scores, trace) = network.value(&picture).unwrap();
    let size = scores.iter().fold(0.0f64, |s, x| s.max(x.abs()));
    assert!(size > 1e-3 && size < 1e3, "{size}");
    let u = noise(1000, 3);
    let direction = noise(picture.len(), 4);
    let (forward, backward) = (
        dot(&network.tangent(&trace, &direction).unwrap(), &u),
        dot(&network.adjoint(&trace, &u).unwrap(), &direction),
    );
    assert!((forward - backward).abs() < 1e-3 * forward.abs().max(size), "{forward} and {backward}");
    // In full width shapes agree with one another, layer by layer, up to the first that is cut short here.
    let mut wrong = weights(16);
    wrong.iter_mut().find(|(n, _)| n == "classifier.0.weight").unwrap().1.shape = vec![256 * 2, 784];
    let Err(Fault::Weights(why)) = self::network(&description, &wrong) else { panic!("it was taken") };
    assert!(why.contains("[512, 784], which does not take the 1568 numbers of 7×7 pixels of 32 channels"), "{why}");
}

/// Every description of the library is read, and asks for its weights by the right names.
#[test]
fn descriptions_of_the_library_ask_for_weights() {
    for (name, text) in SHIPPED {
        let description = Description::parse(text).unwrap_or_else(|e| panic!("{name}: {e}"));
        let empty = safetensors::decode(encode([])).unwrap();
        let Err(Fault::Weights(why)) = Network::new(description, &empty) else { panic!("{name} needs weights") };
        assert!(
            why.starts_with("layer 1 (conv): there is no `") && why.ends_with(".weight` in an empty file"),
            "{why}"
        );
    }
}

#[test]
fn wrong_descriptions_and_weights_are_refused_in_words() {
    let (_, description, weights) = networks().swap_remove(0);
    let changed = |change: &dyn Fn(&mut Json)| {
        let mut description = description.clone();
        change(&mut description);
        match network(&description, &weights) {
            Err(Fault::Description(why)) => why,
            Err(Fault::Weights(why)) => format!("weights: {why}"),
            Ok(_) => "nothing".to_owned(),
        }
    };
    type Change = &'static dyn Fn(&mut Json);
    let cases: [(Change, &str); 18] = [
        (&|d| d["layers"] = json!([]), "it has no layers"),
        (&|d| d["layers"][0]["kind"] = json!("deconv"), "unknown variant `deconv`"),
        (&|d| d["layers"][0]["strides"] = json!(2), "unknown field `strides`"),
        (&|d| d["layers"][4]["groups"] = json!(2), "layer 5: `add` has no `groups`"),
        (&|d| d["layers"][4]["with"] = Json::Null, "layer 5: `add` needs `with`"),
        (&|d| d["layers"][4]["with"] = json!("fc"), "layer 5 (add): no layer before has the label `fc`"),
        (&|d| d["layers"][4]["from"] = json!("fc"), "no layer before has the label `fc`"),
        (&|d| d["layers"][5]["label"] = json!("sum"), "a second layer is called `sum`"),
        (
            &|d| d["layers"][7]["with"] = json!("in"),
            "10×12 pixels of 6 channels cannot be added to 4×6 pixels of 6 channels",
        ),
        (&|d| d["layers"][0]["stride"] = json!(0), "`stride` must be at least 1"),
        (&|d| d["layers"][0]["stride"] = json!(-1), "did not match any variant"),
        (&|d| d["layers"][0]["padding"] = json!("full"), "did not match any variant"),
        (&|d| d["layers"][2]["groups"] = json!(5), "which does not take 12 channels in 5 groups"),
        (
            &|d| d["layers"][0]["dilation"] = json!(9_000_000_000_000_000_000u64),
            "layer 1 (conv): a window without or with too many pixels",
        ),
        (&|d| d["layers"][8]["size"] = json!(40), "a window of 40×40 pixels over 4×6 pixels of 6 channels"),
        (&|d| d["input"]["width"] = json!(0), "an input of 0×19 pixels"),
        (&|d| d["input"]["std"][1] = json!(0), "`std` above 0"),
        (&|d| d["layers"].as_array_mut().unwrap().truncate(8), "its last layer has 4×6 pixels"),
    ];
    for (number, (change, why)) in cases.iter().enumerate() {
        let found = changed(*change);
        assert!(found.contains(why), "case {number}: {found}");
    }
    let without = |name: &str, change: &dyn Fn(&mut Tensor)| {
        let mut weights = weights.clone();
        weights.iter_mut().filter(|(n, _)| n == name).for_each(|(_, a)| change(a));
        weights.retain(|(_, a)| a.shape != [0]);
        match network(&description, &weights) {
            Err(Fault::Weights(why)) => why,
            _ => "nothing".to_owned(),
        }
    };
    for (name, change, why) in [
        (
            "deep.weight",
            (&|a: &mut Tensor| a.shape = vec![0]) as &dyn Fn(&mut Tensor),
            "layer 3 (conv): there is no `deep.weight` among `stem.weight`, `wide.weight`, `thin.weight` and",
        ),
        (
            "stem.weight",
            &|a| a.shape = vec![6, 27],
            "`stem.weight` has shape [6, 27]; outputs, inputs, height, width were expected",
        ),
        ("fc.weight", &|a| a.shape = vec![6, 7], "which does not take the 6 numbers of 1×1 pixels of 6 channels"),
        ("fc.bias", &|a| a.shape = vec![7, 1], "`fc.bias` has shape [7, 1], not [7]"),
        ("n1.bias", &|a| a.shape = vec![3, 4], "`n1.bias` has shape [3, 4], not [12]"),
        ("n0.running_var", &|a| a.data[2] = -1.0, "has a variance that is not above −ε"),
        ("n0.weight", &|a| a.data[0] = f64::NAN, "`n0.weight` has a number that is not finite (NaN)"),
    ] {
        let found = without(name, change);
        assert!(found.contains(why), "{name}: {found}");
    }
}

/// A script beside the files of a network.
struct Script {
    folder: tempfile::TempDir,
}

impl Script {
    fn new() -> Script {
        let folder = tempfile::tempdir().unwrap();
        let (_, description, weights) = networks().swap_remove(0);
        std::fs::write(folder.path().join("net.json"), description.to_string()).unwrap();
        std::fs::write(folder.path().join("net.safetensors"), file(&weights)).unwrap();
        Script { folder }
    }

    fn engine(&self, text: &str) -> Result<Engine, Diagnostic> {
        let path = self.folder.path().join("s.dscene");
        let Checked { program, diagnostics, .. } = check_text("s.dscene", Some(path.as_path()), text, &[], &Disk);
        match diagnostics.into_iter().find(Diagnostic::is_error) {
            Some(d) => Err(d),
            None => Ok(Engine::new(
                program.expect("a program"),
                EngineOptions { base_dir: self.folder.path().into(), ..Default::default() },
            )),
        }
    }

    /// The value of `result`, or what is wrong with the script.
    fn result(&self, text: &str) -> Result<Value, (String, String)> {
        let shown = |d: Diagnostic| (d.message.clone(), d.helps.join("\n"));
        let mut engine = self.engine(text).map_err(shown)?;
        let mut program = engine.program().clone();
        let Some(Line::Expr(e)) = check_line(&mut program, "result").0 else { panic!("{text}") };
        engine.eval(&e).map_err(|d| {
            let picture = render(&d, &program.sources, RenderOptions::plain());
            assert!(picture.contains("s.dscene:"), "it has no place in the script: {picture}");
            shown(d)
        })
    }

    fn numbers(&self, text: &str) -> Vec<f64> {
        let value = self.result(text).unwrap_or_else(|e| panic!("{text}: {e:?}"));
        value.var().unwrap_or_else(|| panic!("{text}")).value().data.clone()
    }
}

const LOAD: &str = "let net = load_network(\"net.safetensors\", layers: \"net.json\")\n\
    param p = 0.5 + 0.3 * noise([31, 40, 3])\nparam grey = 0.5 + 0.3 * noise([12, 9])\n";

#[test]
fn scripts_have_scores_and_their_derivatives() {
    on_large_stack(|| {
        let script = Script::new();
        let numbers = |result: &str| script.numbers(&format!("{LOAD}let result = {result}"));
        let scores = numbers("classifier(net, image(p))");
        assert_eq!(scores.len(), 7);
        // The middle of an image in the proportions of the network, in its size: here 31 × 38 of 31 × 40, as 19 × 23.
        let middle = "resize(crop(image(p), x: 1, y: 0, width: 38, height: 31), width: 23, height: 19)";
        assert_eq!(scores, numbers(&format!("classifier(net, {middle})")));
        // Grey has three equal channels.
        assert_eq!(numbers("classifier(net, image(grey))"), numbers("classifier(net, image(grey) * [1, 1, 1])"));
        let sum = |x: &[f64]| x.iter().sum::<f64>();
        assert!((sum(&numbers("softmax(classifier(net, image(p)))")) - 1.0).abs() < 1e-12);
        assert_eq!(numbers("log_softmax([1000, 0, -1000])"), [0.0, -1000.0, -2000.0]);
        let loss = "log_softmax(classifier(net, image(p)))[3]";
        // Along the gradient, where differences have the fewest kinks.
        let gradient = numbers(&format!("grad({loss}, p)"));
        let (largest, square) = (gradient.iter().fold(0.0f64, |s, x| s.max(x.abs())), dot(&gradient, &gradient));
        let along = Tensor { shape: vec![31, 40, 3], data: gradient.iter().map(|x| x / largest).collect() };
        std::fs::write(script.folder.path().join("along.npy"), npy::encode(&along)).unwrap();
        let along = "load_array(\"along.npy\")";
        let forward = numbers(&format!("jvp({loss}, p, {along})"))[0];
        let differences = numbers(&format!(
            "(({loss} with {{ p: p + 0.001 * {along} }}) - ({loss} with {{ p: p - 0.001 * {along} }})) / 0.002"
        ))[0];
        let reverse = square / largest;
        assert!((reverse - forward).abs() < 1e-5 * forward.abs(), "{reverse} {forward}");
        assert!((differences - forward).abs() < 0.01 * forward.abs(), "{differences} {forward}");
        let (why, help) = script.result(&format!("{LOAD}let result = grad(sum(grad({loss}, p)), p)")).err().unwrap();
        assert!(why.contains("classifier") || help.contains("classifier"), "{why}\n{help}");
    });
}

#[test]
fn faults_of_files_are_told_at_the_call() {
    on_large_stack(|| {
        let script = Script::new();
        let path = |name: &str| script.folder.path().join(name);
        let bytes = std::fs::read(path("net.safetensors")).unwrap();
        std::fs::write(path("cut.safetensors"), &bytes[..bytes.len() - 100]).unwrap();
        std::fs::write(path("huge.safetensors"), [&u64::MAX.to_le_bytes()[..], &bytes].concat()).unwrap();
        std::fs::write(path("text.json"), "{\"layers\": [}").unwrap();
        let mut weights = networks().swap_remove(0).2;
        weights.remove(2);
        std::fs::write(path("less.safetensors"), file(&weights)).unwrap();
        let mut cases = String::new();
        for (call, why) in [
            ("load_network(\"none.safetensors\", layers: \"net.json\")", "there is no file `none.safetensors`"),
            ("load_network(\"net.safetensors\", layers: \"none.json\")", "none.json: there is no such file"),
            ("load_network(\"net.safetensors\", layers: \"vgg19\")", "describes no network called \"vgg19\""),
            (
                "load_network(\"net.safetensors\", layers: \"vgg16\")",
                "net.safetensors: layer 1 (conv): there is no `features.0.weight`",
            ),
            ("load_network(\"net.safetensors\", layers: \"text.json\")", "text.json: "),
            (
                "load_network(\"cut.safetensors\", layers: \"net.json\")",
                "cut.safetensors: it ends within the numbers of `",
            ),
            ("load_network(\"huge.safetensors\", layers: \"net.json\")", "huge.safetensors: its header should have"),
            ("load_network(\"net.json\", layers: \"net.json\")", "net.json: its header should have"),
            ("load_network(\"less.safetensors\", layers: \"net.json\")", "there is no `deep.weight`"),
            (
                "classifier(load_network(\"net.safetensors\", layers: \"net.json\"), image([[[0.1, 0.2]]]))",
                "an image of 2 channels",
            ),
        ] {
            let (found, help) = script.result(&format!("let result = {call}")).err().unwrap_or_default();
            if !found.contains(why) {
                writeln!(cases, "{call}: {found}\n{help}").unwrap();
            }
        }
        assert!(cases.is_empty(), "{cases}");
        let wrong = script.engine(&format!("{LOAD}let result = classifier(\"net\", image(p))")).err().unwrap();
        assert!(wrong.message.contains("network"), "{}", wrong.message);
    });
}
