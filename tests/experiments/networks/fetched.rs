//! The real network: EfficientNet-lite0 with the weights that `examples/networks/fetch` brings.
//!
//! Only `.ci/run`, which fetches them, sets `DSCENE_NETWORKS`; without it these tests say that they are skipped. With it weights that are
//! missing are a failure.

use std::path::PathBuf;

use assert_cmd::Command;
use dscene::data::safetensors;
use dscene::network::{Description, Network, SHIPPED};
use dscene::tape::Tensor;

use super::plain::reference;
use super::{Weights, dot, noise};

const HOW: &str =
    "`examples/networks/fetch` brings the weights (it needs Python with pip), DSCENE_NETWORKS=1 asks for these tests";

/// The bytes of the weights, if these tests are asked for.
fn wanted() -> Option<Vec<u8>> {
    if std::env::var_os("DSCENE_NETWORKS").is_none() {
        eprintln!("skipped: {HOW}");
        return None;
    }
    let path = examples().join("networks/efficientnet_lite0.safetensors");
    Some(std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}; {HOW}", path.display())))
}

fn examples() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("examples")
}

fn text() -> &'static str {
    SHIPPED.into_iter().find(|(name, _)| *name == "efficientnet_lite0").unwrap().1
}

fn network(bytes: Vec<u8>) -> Network {
    let network = Network::new(Description::parse(text()).unwrap(), &safetensors::decode(bytes).unwrap());
    network.unwrap_or_else(|e| panic!("{e:?}"))
}

/// A red disk on a green gradient, neither black nor white anywhere.
fn picture() -> Vec<f64> {
    let pixel = |i: usize| {
        let (v, u) = ((i / 224) as f64 / 223.0, (i % 224) as f64 / 223.0);
        if (u - 0.45).hypot(v - 0.55) < 0.3 {
            [0.56 - 0.18 * v, 0.23 + 0.12 * u, 0.224]
        } else {
            [0.2 + 0.12 * u, 0.38 + 0.24 * v, 0.26 + 0.06 * u]
        }
    };
    (0..224 * 224).flat_map(pixel).collect()
}

#[test]
fn scores_are_those_of_plain_loops() {
    let Some(bytes) = wanted() else { return };
    let arrays = safetensors::decode(bytes.clone()).unwrap();
    let array = |name: &str| {
        let array = arrays.floats(name).unwrap().unwrap();
        let data = array.data.into_iter().map(f64::from).collect();
        (name.to_owned(), Tensor { shape: array.shape, data })
    };
    let weights: Weights = arrays.names().map(array).collect();
    let network = network(bytes);
    assert_eq!((network.picture(), network.classes()), ((224, 224), 1000));
    let found = network.value(&picture()).unwrap().0;
    let wanted = reference(&serde_json::from_str(text()).unwrap(), &weights, &picture());
    let far = found.iter().zip(&wanted).fold(0.0f64, |s, (a, b)| s.max((a - b).abs()));
    let size = wanted.iter().fold(0.0f64, |s, x| s.max(x.abs()));
    assert!(size > 1.0 && far < 1e-4 * size, "off by {far} of {size}");
}

/// Along the gradient of the first class's score. Steps are small, because a picture without texture has whole regions whose activations
/// reach their kinks together: a hundred times this step gives two thirds of the derivative.
#[test]
fn gradients_are_differences() {
    let Some(bytes) = wanted() else { return };
    let network = network(bytes);
    let picture = picture();
    let (scores, trace) = network.value(&picture).unwrap();
    let first = (0..1000).max_by(|a, b| scores[*a].total_cmp(&scores[*b])).unwrap();
    let mut unit = vec![0.0; 1000];
    unit[first] = 1.0;
    let gradient = network.adjoint(&trace, &unit).unwrap();
    let norm = dot(&gradient, &gradient).sqrt();
    let moved = |by: f64| {
        let moved: Vec<f64> = picture.iter().zip(&gradient).map(|(x, g)| x + by / norm * g).collect();
        network.value(&moved).unwrap().0[first]
    };
    let h = 1e-4;
    let difference = (moved(h) - moved(-h)) / (2.0 * h);
    assert!((difference / norm - 1.0).abs() < 0.03, "{difference} and {norm}");
    // Both modes are one derivative.
    let direction = noise(picture.len(), 3);
    let (forward, backward) = (network.tangent(&trace, &direction).unwrap()[first], dot(&gradient, &direction));
    assert!((forward - backward).abs() < 1e-4 * norm * direction.len() as f64 / 300.0, "{forward} and {backward}");
}

/// How likely the picture is a teapot to the network, in percent, after all steps of the example.
fn left(folder: &std::path::Path, boundary: bool) -> (bool, f64) {
    let mut command = Command::cargo_bin("dsl").unwrap();
    command.arg("run").arg(examples().join("20_adversarial.dscene")).args(["--quiet", "--out"]).arg(folder.join("o"));
    command.args(["--force", "--set", &format!("direct.boundary={boundary}")]);
    let output = command.timeout(std::time::Duration::from_secs(300)).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let last = text.lines().rfind(|line| line.starts_with("after 25 steps:"));
    let percent = last.and_then(|line| line.rsplit_once("teapot ")?.1.trim_end_matches(" %").parse().ok());
    let percent = percent.unwrap_or_else(|| panic!("{text}{}", String::from_utf8_lossy(&output.stderr)));
    (output.status.success(), percent)
}

/// The paper's experiment: it takes silhouettes and shadows to mislead the network by moving things so little.
#[test]
fn the_example_misleads_the_network() {
    if wanted().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (holds, whole) = left(folder.path(), true);
    assert!(holds && whole < 25.0, "still {whole} %");
    let (_, interior) = left(folder.path(), false);
    assert!(interior > 1.5 * whole, "{interior} % without silhouettes, {whole} % with them");
}
