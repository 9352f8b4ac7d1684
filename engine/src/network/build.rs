//! From a description and a file of weights to a network: every shape is held against every other before anything is computed.

use std::collections::HashMap;

use super::conv::{Conv, Size, Window};
use super::description::{self, Description, Kind, NamedPadding, Padding, Pair};
use super::pool::Pool;
use super::{Fault, Layer, Network, Op};
use crate::data::safetensors::{Array, Arrays};
use crate::memory;
use crate::stop;

/// Most numbers of one layer's output.
const LARGEST: usize = 1 << 30;

impl Network {
    /// A network of these layers with these weights.
    pub fn new(description: Description, weights: &Arrays) -> Result<Network> {
        let input = Size { height: description.input.height, width: description.input.width, channels: 3 };
        let mut builder = Builder { weights, epsilon: description.epsilon, sizes: vec![input], labels: HashMap::new() };
        let mut layers = Vec::new();
        for (number, layer) in description.layers.iter().enumerate() {
            stop::check();
            let place = |why: String| format!("layer {} ({}): {why}", number + 1, layer.kind.name());
            let built = builder.layer(layer).map_err(|fault| match fault {
                Fault::Description(why) => Fault::Description(place(why)),
                Fault::Weights(why) => Fault::Weights(place(why)),
            })?;
            layers.push(built);
        }
        let Some(last) = layers.last() else { return Err(Fault::Description("it has no layers".to_owned())) };
        if last.output.pixels() != 1 {
            let Size { height, width, .. } = last.output;
            let why = format!("its last layer has {height}×{width} pixels; scores of classes have one");
            return Err(Fault::Description(why));
        }
        let mut last_use = vec![0; layers.len() + 1];
        for (number, layer) in layers.iter().enumerate() {
            last_use[layer.from] = number;
            if let Op::Add(with) = layer.op {
                last_use[with] = number;
            }
        }
        Ok(Network { input: description.input, layers, last_use })
    }
}

struct Builder<'a> {
    weights: &'a Arrays,
    epsilon: f64,
    /// Of all activations so far.
    sizes: Vec<Size>,
    /// Their numbers by label.
    labels: HashMap<String, usize>,
}

type Result<T> = std::result::Result<T, Fault>;

fn wrong<T>(why: impl Into<String>) -> Result<T> {
    Err(Fault::Description(why.into()))
}

fn misfit<T>(why: impl Into<String>) -> Result<T> {
    Err(Fault::Weights(why.into()))
}

impl Builder<'_> {
    fn layer(&mut self, layer: &description::Layer) -> Result<Layer> {
        let from = match &layer.from {
            Some(label) => self.labelled(label)?,
            None => self.sizes.len() - 1,
        };
        let input = self.sizes[from];
        let name = layer.name.as_deref().unwrap_or_default();
        let (op, output) = match layer.kind {
            Kind::Conv => self.conv(layer, name, input)?,
            Kind::Linear => self.linear(layer, name, input)?,
            Kind::Norm => {
                let (scale, shift) = self.norm(name, input.channels)?;
                (Op::Norm { scale, shift }, input)
            }
            Kind::MaxPool | Kind::MeanPool => {
                let pool = pool(layer, input)?;
                let output = pool.output;
                (if layer.kind == Kind::MaxPool { Op::MaxPool(pool) } else { Op::MeanPool(pool) }, output)
            }
            Kind::Add => {
                let with = self.labelled(layer.with.as_deref().unwrap_or_default())?;
                if self.sizes[with] != input {
                    return wrong(format!("{} cannot be added to {}", shown(self.sizes[with]), shown(input)));
                }
                (Op::Add(with), input)
            }
        };
        if let Some(label) = &layer.label
            && self.labels.insert(label.clone(), self.sizes.len()).is_some()
        {
            return wrong(format!("a second layer is called `{label}`"));
        }
        self.sizes.push(output);
        Ok(Layer { op, from, activation: layer.activation, output })
    }

    fn labelled(&self, label: &str) -> Result<usize> {
        match self.labels.get(label) {
            Some(number) => Ok(*number),
            None => wrong(format!("no layer before has the label `{label}`")),
        }
    }

    fn conv(&self, layer: &description::Layer, name: &str, input: Size) -> Result<(Op, Size)> {
        let weights = self.floats(&format!("{name}.weight"))?;
        let [outputs, inputs, height, width] = weights.shape[..] else {
            return misfit(format!(
                "`{name}.weight` has shape {:?}; outputs, inputs, height, width were expected",
                weights.shape
            ));
        };
        let groups = layer.groups.unwrap_or(1);
        if inputs.checked_mul(groups) != Some(input.channels) || outputs % groups != 0 || outputs == 0 {
            let of = if groups == 1 { String::new() } else { format!(" in {groups} groups") };
            return misfit(format!(
                "`{name}.weight` has shape {:?}, which does not take {} channels{of}",
                weights.shape, input.channels
            ));
        }
        let stride = layer.stride.map_or([1, 1], Pair::get);
        let dilation = layer.dilation.map_or([1, 1], Pair::get);
        let (window, pixels) = slide([height, width], stride, dilation, layer.padding, input)?;
        let output = Size { height: pixels[0], width: pixels[1], channels: outputs };
        self.finished(layer, name, (input, output, window, groups), weights.data)
    }

    fn linear(&self, layer: &description::Layer, name: &str, input: Size) -> Result<(Op, Size)> {
        let weights = self.floats(&format!("{name}.weight"))?;
        let [outputs, inputs] = weights.shape[..] else {
            return misfit(format!("`{name}.weight` has shape {:?}; outputs, inputs were expected", weights.shape));
        };
        if inputs != input.len() || outputs == 0 {
            return misfit(format!(
                "`{name}.weight` has shape {:?}, which does not take the {} numbers of {}",
                weights.shape,
                input.len(),
                shown(input)
            ));
        }
        // Files order a layer's inputs as those of a window over all of them.
        let output = Size { height: 1, width: 1, channels: outputs };
        self.finished(layer, name, (input, output, Window::whole(input), 1), weights.data)
    }

    /// A convolution with its bias and the normalisation that follows it.
    fn finished(
        &self,
        layer: &description::Layer,
        name: &str,
        (input, output, window, groups): (Size, Size, Window, usize),
        mut weights: Vec<f32>,
    ) -> Result<(Op, Size)> {
        let outputs = output.channels;
        // They are copied into the order in which products take them, for both modes.
        memory::ask_for::<f32>(weights.len().saturating_mul(2)).map_err(|e| Fault::Weights(e.to_string()))?;
        if output.pixels().checked_mul(outputs).is_none_or(|n| n > LARGEST) {
            return wrong(format!("its output of {} is too large", shown(output)));
        }
        let bias = match self.found(&format!("{name}.bias"))? {
            Some(bias) if bias.shape == [outputs] => Some(bias.data),
            Some(bias) => return misfit(format!("`{name}.bias` has shape {:?}, not [{outputs}]", bias.shape)),
            None => None,
        };
        let mut bias = bias.unwrap_or_else(|| vec![0.0; outputs]);
        if let Some(norm) = &layer.norm {
            let (scale, shift) = self.norm(norm, outputs)?;
            let each = weights.len() / outputs;
            for (weights, scale) in stop::paced(weights.chunks_mut(each), each).zip(&scale) {
                weights.iter_mut().for_each(|w| *w *= scale);
            }
            bias.iter_mut().zip(scale).zip(shift).for_each(|((b, scale), shift)| *b = *b * scale + shift);
        }
        Ok((Op::Conv(Conv::new(input, output, window, groups, &weights, bias)), output))
    }

    /// Batch normalisation as `x · scale + shift`.
    fn norm(&self, name: &str, channels: usize) -> Result<(Vec<f32>, Vec<f32>)> {
        let part = |part: &str| {
            let array = self.floats(&format!("{name}.{part}"))?;
            match array.shape == [channels] {
                true => Ok(array.data),
                false => misfit(format!("`{name}.{part}` has shape {:?}, not [{channels}]", array.shape)),
            }
        };
        let (weight, bias) = (part("weight")?, part("bias")?);
        let (mean, variance) = (part("running_mean")?, part("running_var")?);
        let scale: Vec<f64> =
            weight.iter().zip(&variance).map(|(w, v)| f64::from(*w) / (f64::from(*v) + self.epsilon).sqrt()).collect();
        if scale.iter().any(|s| !s.is_finite()) {
            return misfit(format!("`{name}.running_var` has a variance that is not above −ε"));
        }
        let shift = scale.iter().zip(bias).zip(mean).map(|((s, b), m)| (f64::from(b) - f64::from(m) * s) as f32);
        Ok((scale.iter().map(|s| *s as f32).collect(), shift.collect()))
    }

    fn found(&self, name: &str) -> Result<Option<Array>> {
        self.weights.floats(name).map_err(Fault::Weights)
    }

    fn floats(&self, name: &str) -> Result<Array> {
        match self.found(name)? {
            Some(array) => Ok(array),
            None => {
                let names: Vec<&str> = self.weights.names().take(3).collect();
                let (shown, more) = (names.join("`, `"), self.weights.names().count().saturating_sub(names.len()));
                misfit(match (names.is_empty(), more) {
                    (true, _) => format!("there is no `{name}` in an empty file"),
                    (_, 0) => format!("there is no `{name}` among `{shown}`"),
                    _ => format!("there is no `{name}` among `{shown}` and {more} more"),
                })
            }
        }
    }
}

fn pool(layer: &description::Layer, input: Size) -> Result<Pool> {
    let size = layer.size.map_or([input.height, input.width], Pair::get);
    let stride = layer.stride.map_or(size, Pair::get);
    let (window, pixels) = slide(size, stride, [1, 1], layer.padding, input)?;
    let pool = Pool { input, output: Size { height: pixels[0], width: pixels[1], ..input }, window };
    if pool.output.pixels().saturating_mul(window.taps()) > LARGEST || pool.output.len() > LARGEST {
        return wrong(format!("its output of {} is too large", shown(pool.output)));
    }
    memory::ask_for::<u64>(pool.output.pixels()).map_err(|e| Fault::Description(e.to_string()))?;
    if !pool.sees_something() { wrong("a window lies wholly in the padding") } else { Ok(pool) }
}

/// The window and how many times it fits, along y and x.
fn slide(
    size: [usize; 2],
    stride: [usize; 2],
    dilation: [usize; 2],
    padding: Option<Padding>,
    input: Size,
) -> Result<(Window, [usize; 2])> {
    let all = [input.height, input.width];
    let (mut before, mut count) = ([0; 2], [0; 2]);
    for axis in 0..2 {
        let (n, step) = (all[axis], stride[axis]);
        let reach = size[axis].checked_sub(1).and_then(|taps| taps.checked_mul(dilation[axis])).map(|r| r + 1);
        let Some(reach) = reach.filter(|r| *r <= LARGEST) else {
            return wrong("a window without or with too many pixels");
        };
        let behind = match padding {
            None => 0,
            Some(Padding::Pixels(pair)) => {
                before[axis] = pair.get()[axis];
                before[axis]
            }
            Some(Padding::Named(NamedPadding::Same)) => {
                let total = ((n.div_ceil(step) - 1) * step + reach).saturating_sub(n);
                before[axis] = total / 2;
                total - total / 2
            }
        };
        let padded = n.saturating_add(before[axis]).saturating_add(behind);
        if reach > padded || padded > LARGEST {
            return wrong(format!("a window of {}×{} pixels over {}", size[0], size[1], shown(input)));
        }
        count[axis] = (padded - reach) / step + 1;
    }
    Ok((Window { size, stride, dilation, before }, count))
}

fn shown(size: Size) -> String {
    format!("{}×{} pixels of {} channels", size.height, size.width, size.channels)
}
