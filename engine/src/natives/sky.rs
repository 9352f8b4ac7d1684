//! The clear sky and the sun behind it.

use std::sync::Arc;

use glam::DVec3;

use super::value::Value;
use super::{Args, Native, NativeError, Result};
use crate::memory;
use crate::render::sky::{Number, Sky};
use crate::stop::paced;
use crate::tape::{CustomOp, Tensor, Var};

pub(super) const TABLE: &[(&str, Native)] = &[("clear_sky", clear_sky), ("sun_irradiance", sun_irradiance)];

/// What is computed of a sky, from the sun's direction, the turbidity and, for a map, the ground's reflectance.
#[derive(Clone, Copy)]
enum What {
    Map { width: usize, height: usize },
    Irradiance,
}

impl What {
    /// The values, each with its factor: of pixels of the ground the reflectance in its channel.
    fn numbers(self, inputs: &[&Tensor]) -> Vec<(Number, Option<usize>)> {
        let sun = DVec3::from_slice(&inputs[0].data);
        let sky = Sky::new(sun, inputs[1].data[0]);
        match self {
            What::Irradiance => sky.sun_irradiance().map(|e| (e, None)).into(),
            What::Map { width, height } => {
                let map = sky.map(width, height);
                let ground = |i: usize| i >= (height / 2) * width;
                let pixel = |(i, rgb): (usize, [Number; 3])| [0, 1, 2].map(|c| (rgb[c], ground(i).then_some(c)));
                paced(map, 3).enumerate().flat_map(pixel).collect()
            }
        }
    }

    fn value(self, inputs: &[&Tensor]) -> Vec<f64> {
        let factor = |channel: Option<usize>| channel.map_or(1.0, |c| inputs[2].data[c]);
        paced(self.numbers(inputs), 1).map(|(n, channel)| n.value * factor(channel)).collect()
    }
}

impl CustomOp for What {
    fn name(&self) -> &str {
        "clear_sky"
    }

    fn vjp(&self, x: &[&Tensor], _: &Tensor, g: &Tensor, _: &[bool]) -> Result<Vec<Option<Tensor>>, String> {
        let (mut d, mut d_ground) = ([0.0; 4], [0.0; 3]);
        for ((n, channel), g) in paced(self.numbers(x), 1).zip(&g.data) {
            let factor = channel.map_or(1.0, |c| x[2].data[c]);
            for (d, partial) in d.iter_mut().zip(n.partials) {
                *d += g * factor * partial;
            }
            if let Some(c) = channel {
                d_ground[c] += g * n.value;
            }
        }
        let of = |like: &Tensor, data: &[f64]| Some(Tensor { shape: like.shape.clone(), data: data.to_vec() });
        let mut out = vec![of(x[0], &d[..3]), of(x[1], &d[3..])];
        out.extend(x.get(2).map(|ground| of(ground, &d_ground)));
        Ok(out)
    }

    fn jvp(&self, x: &[&Tensor], y: &Tensor, t: &[Option<&Tensor>]) -> Result<Tensor, String> {
        let along = |i: usize, j: usize| t.get(i).copied().flatten().map_or(0.0, |t| t.data[j]);
        let tangent = [along(0, 0), along(0, 1), along(0, 2), along(1, 0)];
        let of = |(n, channel): (Number, Option<usize>)| {
            let dot: f64 = n.partials.iter().zip(tangent).map(|(p, t)| p * t).sum();
            channel.map_or(dot, |c| dot * x[2].data[c] + n.value * along(2, c))
        };
        Ok(Tensor { shape: y.shape.clone(), data: paced(self.numbers(x), 1).map(of).collect() })
    }
}

/// The first two arguments: the direction towards the sun, and the turbidity.
fn sun_and_turbidity(a: &Args) -> Result<[Var; 2]> {
    let (sun, turbidity) = (a.vector(0, 3, false)?, a.scalar(1)?);
    let length = sun.value().data.iter().map(|x| x * x).sum::<f64>().sqrt();
    if !(length > 1e-12 && length.is_finite()) {
        return Err(NativeError::at(0, "`sun` must be a direction, which has a length"));
    }
    let x = turbidity.value().data[0];
    if !(1.0..=10.0).contains(&x) {
        return Err(NativeError::at(1, format!("`turbidity` must be from 1 to 10, this is {x}")));
    }
    Ok([sun, turbidity])
}

fn made(what: What, inputs: Vec<Var>, shape: Vec<usize>) -> Var {
    let values: Vec<&Tensor> = inputs.iter().map(Var::value).collect();
    let data = what.value(&values);
    Var::custom(Arc::new(what), inputs, Tensor { shape, data })
}

fn clear_sky(a: &Args) -> Result<Value> {
    let [sun, turbidity] = sun_and_turbidity(a)?;
    let ground = match a.named("ground") {
        Some((i, _)) => a.vector(i, 3, true)?,
        None => Var::constant(Tensor::full(&[3], 0.2)),
    };
    let width = a.named_integer("width", 4..=4096)?.unwrap_or(128) as usize;
    if !width.is_multiple_of(4) {
        let index = a.index("width").unwrap_or_default();
        return Err(NativeError::at(
            index,
            "`width` must be a multiple of 4, so that the horizon lies between two rows",
        ));
    }
    let height = width / 2;
    memory::ask_for::<(Number, Option<usize>)>(width * height * 3)?;
    Ok(Value::Image(made(What::Map { width, height }, vec![sun, turbidity, ground], vec![height, width, 3])))
}

fn sun_irradiance(a: &Args) -> Result<Value> {
    Ok(Value::Num(made(What::Irradiance, sun_and_turbidity(a)?.into(), vec![3])))
}
