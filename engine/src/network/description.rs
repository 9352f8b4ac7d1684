//! The JSON that describes a network: what it wants to see, and its layers in order. `stdlib/networks/README.md` is the reference.

use serde::Deserialize;

/// The descriptions that are part of the library, by name.
pub const SHIPPED: [(&str, &str); 2] = [
    ("efficientnet_lite0", include_str!("../../../stdlib/networks/efficientnet_lite0.json")),
    ("vgg16", include_str!("../../../stdlib/networks/vgg16.json")),
];

/// The largest width and height of an input.
const LARGEST: usize = 4096;

/// A network without its weights: what it wants to see, and its layers in order.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// For people.
    #[serde(default, rename = "about")]
    _about: String,
    pub(crate) input: Input,
    /// Of batch normalisation.
    #[serde(default = "default_epsilon")]
    pub epsilon: f64,
    pub(crate) layers: Vec<Layer>,
}

fn default_epsilon() -> f64 {
    1e-5
}

/// The picture that the network wants: sRGB values from 0 to `range`, less `mean`, by `std`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    pub width: usize,
    pub height: usize,
    pub channels: Order,
    pub range: f64,
    pub mean: [f64; 3],
    pub std: [f64; 3],
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Order {
    Rgb,
    Bgr,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layer {
    pub kind: Kind,
    /// Its weights are `NAME.weight` and, if there is one, `NAME.bias`.
    pub name: Option<String>,
    /// What it is called by `from` and `with` of later layers.
    pub label: Option<String>,
    /// The layer that it takes its input from, if that is not the one before.
    pub from: Option<String>,
    /// What `add` adds.
    pub with: Option<String>,
    /// The window of a pool; of convolutions the weights say it.
    pub size: Option<Pair>,
    pub stride: Option<Pair>,
    pub padding: Option<Padding>,
    pub dilation: Option<Pair>,
    pub groups: Option<usize>,
    /// The batch normalisation that follows a convolution or a linear layer.
    pub norm: Option<String>,
    pub activation: Option<Activation>,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Conv,
    Linear,
    Norm,
    MaxPool,
    MeanPool,
    Add,
}

impl Kind {
    pub fn name(self) -> &'static str {
        match self {
            Kind::Conv => "conv",
            Kind::Linear => "linear",
            Kind::Norm => "norm",
            Kind::MaxPool => "max_pool",
            Kind::MeanPool => "mean_pool",
            Kind::Add => "add",
        }
    }

    /// The entries that it has beyond `label`, `from` and `activation`; the first of these must be there.
    fn entries(self) -> &'static [&'static str] {
        match self {
            Kind::Conv => &["name", "norm", "stride", "padding", "dilation", "groups"],
            Kind::Linear => &["name", "norm"],
            Kind::Norm => &["name"],
            Kind::MaxPool => &["size", "stride", "padding"],
            // Without a window it is the mean of all.
            Kind::MeanPool => &["", "size", "stride", "padding"],
            Kind::Add => &["with"],
        }
    }
}

/// One number for both axes, or `[along y, along x]`.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(untagged)]
pub enum Pair {
    Both(usize),
    Each([usize; 2]),
}

impl Pair {
    pub fn get(self) -> [usize; 2] {
        match self {
            Pair::Both(n) => [n, n],
            Pair::Each(pair) => pair,
        }
    }
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(untagged)]
pub enum Padding {
    /// As many pixels before as behind.
    Pixels(Pair),
    Named(NamedPadding),
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum NamedPadding {
    /// As TensorFlow does it: outputs are inputs by stride, rounded up, and an odd pixel of padding is behind.
    Same,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Activation {
    Relu,
    /// Cut off above 6.
    Relu6,
}

impl Description {
    /// Reads a description. Entries that mean nothing for their layer are errors, because they would be mistakes.
    pub fn parse(text: &str) -> Result<Description, String> {
        let description: Description = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let Input { width, height, range, mean, std, .. } = &description.input;
        if ![width, height].into_iter().all(|n| (1..=LARGEST).contains(n)) {
            return Err(format!("an input of {width}×{height} pixels; from 1×1 to {LARGEST}×{LARGEST} are possible"));
        }
        if !mean.iter().chain([range]).all(|x| x.is_finite()) || !std.iter().all(|x| x.is_finite() && *x > 0.0) {
            return Err("`range` and `mean` must be finite and `std` above 0".to_owned());
        }
        if !(description.epsilon.is_finite() && description.epsilon >= 0.0) {
            return Err(format!("`epsilon` must be 0 or more, this is {}", description.epsilon));
        }
        for (number, layer) in description.layers.iter().enumerate() {
            layer.check().map_err(|why| format!("layer {}: {why}", number + 1))?;
        }
        Ok(description)
    }
}

impl Layer {
    fn check(&self) -> Result<(), String> {
        let (kind, allowed) = (self.kind.name(), self.kind.entries());
        let given = [
            ("name", self.name.is_some()),
            ("with", self.with.is_some()),
            ("size", self.size.is_some()),
            ("stride", self.stride.is_some()),
            ("padding", self.padding.is_some()),
            ("dilation", self.dilation.is_some()),
            ("groups", self.groups.is_some()),
            ("norm", self.norm.is_some()),
        ];
        if let Some((entry, _)) = given.iter().find(|(entry, given)| *given && !allowed.contains(entry)) {
            return Err(format!("`{kind}` has no `{entry}`"));
        }
        if let Some((entry, _)) = given.iter().find(|(entry, given)| !*given && *entry == allowed[0]) {
            return Err(format!("`{kind}` needs `{entry}`"));
        }
        if self.kind == Kind::MeanPool && self.size.is_none() && (self.stride.is_some() || self.padding.is_some()) {
            return Err("`mean_pool` with `stride` or `padding` needs `size`".to_owned());
        }
        let positive = [("size", self.size), ("stride", self.stride), ("dilation", self.dilation)];
        let groups = ("groups", self.groups.map(Pair::Both));
        match positive.into_iter().chain([groups]).find(|(_, pair)| pair.is_some_and(|pair| pair.get().contains(&0))) {
            Some((entry, _)) => Err(format!("`{entry}` must be at least 1")),
            None => Ok(()),
        }
    }
}
