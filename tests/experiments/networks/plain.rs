//! What a network computes, by the plainest loops in double precision: the reference for the fast ones.

use dscene::tape::Tensor;
use serde_json::Value as Json;

use super::Weights;

/// Activations `[channel][y][x]`, as the descriptions' words have them.
#[derive(Clone)]
pub struct Map {
    pub size: [usize; 3],
    pub data: Vec<f64>,
}

impl Map {
    fn new(size: [usize; 3]) -> Map {
        Map { size, data: vec![0.0; size.iter().product()] }
    }

    /// 0 outside.
    fn at(&self, c: usize, y: i64, x: i64) -> Option<f64> {
        let [_, height, width] = self.size;
        let inside = (0..height as i64).contains(&y) && (0..width as i64).contains(&x);
        inside.then(|| self.data[(c * height + y as usize) * width + x as usize])
    }
}

/// The scores of a picture.
pub fn reference(description: &Json, weights: &Weights, picture: &[f64]) -> Vec<f64> {
    activations(description, weights, picture).pop().unwrap().data
}

/// What each layer gives for a picture.
pub fn activations(description: &Json, weights: &Weights, picture: &[f64]) -> Vec<Map> {
    let input = &description["input"];
    let number = |v: &Json| v.as_f64().unwrap();
    let (height, width) = (input["height"].as_u64().unwrap() as usize, input["width"].as_u64().unwrap() as usize);
    let mut seen = Map::new([3, height, width]);
    for (i, x) in picture.iter().enumerate() {
        let (pixel, c) = (i / 3, i % 3);
        let x = x.clamp(0.0, 1.0);
        let encoded = if x <= 0.0031308 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        let to = if input["channels"] == "bgr" { 2 - c } else { c };
        seen.data[to * height * width + pixel] =
            (number(&input["range"]) * encoded - number(&input["mean"][to])) / number(&input["std"][to]);
    }
    let get = |name: String| weights.iter().find(|(n, _)| *n == name).map(|(_, a)| a);
    let epsilon = description["epsilon"].as_f64().unwrap_or(1e-5);
    let normalised = |mut y: Map, name: &str| {
        let part = |part: &str| &get(format!("{name}.{part}")).unwrap().data;
        let per = y.size[1] * y.size[2];
        for (i, y) in y.data.iter_mut().enumerate() {
            let c = i / per;
            let spread = (part("running_var")[c] + epsilon).sqrt();
            *y = (*y - part("running_mean")[c]) / spread * part("weight")[c] + part("bias")[c];
        }
        y
    };
    let mut labelled: Vec<(String, Map)> = Vec::new();
    let mut all: Vec<Map> = Vec::new();
    for layer in description["layers"].as_array().unwrap() {
        let find = |key: &str| labelled.iter().find(|(n, _)| layer[key] == n.as_str()).map(|(_, m)| m.clone());
        let x = find("from").unwrap_or_else(|| all.last().unwrap_or(&seen).clone());
        let name = layer["name"].as_str().unwrap_or_default();
        let mut y = match layer["kind"].as_str().unwrap() {
            "conv" => convolved(layer, &x, get(format!("{name}.weight")).unwrap(), get(format!("{name}.bias"))),
            "linear" => {
                let w = get(format!("{name}.weight")).unwrap();
                let mut y = Map::new([w.shape[0], 1, 1]);
                for (o, y) in y.data.iter_mut().enumerate() {
                    *y = (0..x.data.len()).map(|i| w.data[o * x.data.len() + i] * x.data[i]).sum::<f64>()
                        + get(format!("{name}.bias")).map_or(0.0, |b| b.data[o]);
                }
                y
            }
            "norm" => normalised(x, name),
            "add" => {
                let other = find("with").unwrap();
                Map { data: x.data.iter().zip(&other.data).map(|(a, b)| a + b).collect(), ..x }
            }
            kind => pooled(layer, &x, kind == "max_pool"),
        };
        if let Some(norm) = layer["norm"].as_str() {
            y = normalised(y, norm);
        }
        let top = [("relu", f64::INFINITY), ("relu6", 6.0)].into_iter().find(|(n, _)| layer["activation"] == *n);
        if let Some((_, top)) = top {
            y.data.iter_mut().for_each(|y| *y = y.clamp(0.0, top));
        }
        if let Some(label) = layer["label"].as_str() {
            labelled.push((label.to_owned(), y.clone()));
        }
        all.push(y);
    }
    all
}

fn pair(v: &Json, default: usize) -> [i64; 2] {
    match v {
        Json::Null => [default as i64; 2],
        Json::Array(pair) => [pair[0].as_i64().unwrap(), pair[1].as_i64().unwrap()],
        n => [n.as_i64().unwrap(); 2],
    }
}

/// Outputs and padding before, along y and x.
fn slid(layer: &Json, x: &Map, size: [i64; 2], stride: [i64; 2], dilation: [i64; 2]) -> ([usize; 2], [i64; 2]) {
    let (mut count, mut before) = ([0; 2], [0; 2]);
    for a in 0..2 {
        let (n, reach) = (x.size[a + 1] as i64, (size[a] - 1) * dilation[a] + 1);
        if layer["padding"] == "same" {
            count[a] = ((n + stride[a] - 1) / stride[a]) as usize;
            before[a] = ((count[a] as i64 - 1) * stride[a] + reach - n).max(0) / 2;
        } else {
            before[a] = pair(&layer["padding"], 0)[a];
            count[a] = ((n + 2 * before[a] - reach) / stride[a] + 1) as usize;
        }
    }
    (count, before)
}

fn convolved(layer: &Json, x: &Map, weights: &Tensor, bias: Option<&Tensor>) -> Map {
    let [outputs, inputs, kh, kw] = weights.shape[..] else { panic!("{:?}", weights.shape) };
    let (stride, dilation) = (pair(&layer["stride"], 1), pair(&layer["dilation"], 1));
    let groups = layer["groups"].as_u64().unwrap_or(1) as usize;
    let ([height, width], before) = slid(layer, x, [kh as i64, kw as i64], stride, dilation);
    let mut y = Map::new([outputs, height, width]);
    for i in 0..y.data.len() {
        let (o, row, column) = (i / (height * width), i / width % height, i % width);
        let mut sum = bias.map_or(0.0, |b| b.data[o]);
        for (c, ky, kx) in (0..inputs).flat_map(|c| (0..kh).flat_map(move |ky| (0..kw).map(move |kx| (c, ky, kx)))) {
            let from = o / (outputs / groups) * inputs + c;
            let at = |out: usize, k: usize, a: usize| out as i64 * stride[a] + k as i64 * dilation[a] - before[a];
            let seen = x.at(from, at(row, ky, 0), at(column, kx, 1)).unwrap_or(0.0);
            sum += seen * weights.data[((o * inputs + c) * kh + ky) * kw + kx];
        }
        y.data[i] = sum;
    }
    y
}

fn pooled(layer: &Json, x: &Map, largest: bool) -> Map {
    let [channels, h, w] = x.size;
    let size = if layer["size"].is_null() { [h as i64, w as i64] } else { pair(&layer["size"], 0) };
    let stride = if layer["stride"].is_null() { size } else { pair(&layer["stride"], 0) };
    let ([height, width], before) = slid(layer, x, size, stride, [1, 1]);
    let mut y = Map::new([channels, height, width]);
    for i in 0..y.data.len() {
        let (c, row, column) = (i / (height * width), i / width % height, i % width);
        let at = |out: usize, k: i64, a: usize| out as i64 * stride[a] + k - before[a];
        let seen: Vec<f64> = (0..size[0])
            .flat_map(|ky| (0..size[1]).map(move |kx| (ky, kx)))
            .filter_map(|(ky, kx)| x.at(c, at(row, ky, 0), at(column, kx, 1)))
            .collect();
        y.data[i] = match largest {
            true => seen.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            false => seen.iter().sum::<f64>() / seen.len() as f64,
        };
    }
    y
}
