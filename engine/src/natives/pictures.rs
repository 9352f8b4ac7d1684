//! Pictures for people: contact sheets and false colours.

use crate::image::colormap::Colormap;
use crate::memory;
use crate::stop::{Pace, paced};
use crate::tape::{Binary, Tensor, Unary, Var};

use super::value::Value;
use super::{Args, Native, NativeError, Result};

pub(super) const TABLE: &[(&str, Native)] = &[("montage", montage), ("colormap", colormap)];

/// Rows of images in cells of one size, each in the middle of its cell. An image of one channel among images of three is grey.
fn montage(a: &Args) -> Result<Value> {
    let items = a.value(0)?.items().ok_or_else(|| a.wrong(0, "an array of images"))?;
    let images: Option<Vec<Var>> = items
        .into_iter()
        .map(|item| match item {
            Value::Image(v) => Some(v),
            Value::Num(v) if v.shape().len() == 3 => Some(v),
            _ => None,
        })
        .collect();
    let images = images.ok_or_else(|| a.wrong(0, "an array of images"))?;
    let side = |axis: usize| images.iter().map(|image| image.shape()[axis]).max().unwrap_or(0);
    let (height, width, channels) = (side(0), side(1), side(2));
    if images.is_empty() || images.iter().any(|image| image.is_empty()) {
        return Err(
            NativeError::at(0, "there are no images to show").help("give at least one, with at least one pixel")
        );
    }
    if let Some(other) = images.iter().map(|image| image.shape()[2]).find(|&n| n != channels && (n, channels) != (1, 3))
    {
        let what = format!("images of {other} and of {channels} channels do not go together");
        return Err(
            NativeError::at(0, what).help("only grey images, of one channel, go together with colours, of three")
        );
    }
    let count = images.len();
    let columns = match a.named_integer("columns", 1..=1 << 16)? {
        Some(n) => (n as usize).min(count),
        // As square as it gets.
        None => (1..=count).find(|n| n * n >= count).unwrap_or(count),
    };
    let gap = a.named_integer("gap", 0..=1 << 16)?.unwrap_or(4) as usize;
    let value = match a.named("value") {
        Some((i, _)) => a.vector(i, channels, true)?,
        None => Var::constant(Tensor::new(vec![channels], vec![1.0; channels])),
    };
    let rows = count.div_ceil(columns);
    let across = |cells: usize, side: usize| cells.saturating_mul(side).saturating_add((cells - 1) * gap);
    let (whole_height, whole_width) = (across(rows, height), across(columns, width));
    if whole_height.saturating_mul(whole_width) > crate::image::MAX_FILM_PIXELS {
        return Err(NativeError::new(format!("an image of {whole_width}×{whole_height} pixels")));
    }
    memory::ask_for::<f64>(2 * whole_width * whole_height * channels)?;
    // The numbers of all images one after the other, and behind them those of the gaps, are picked pixel by pixel.
    let parts = images.iter().chain([&value]).map(|part| part.reshape(vec![part.len()]));
    let numbers = Var::concat(&parts.collect::<Result<Vec<Var>, _>>()?, 0)?;
    let behind = numbers.len() - channels;
    if u32::try_from(numbers.len()).is_err() {
        return Err(NativeError::at(0, "these images are too large to show together"));
    }
    let empty = paced(0..whole_height * whole_width, channels).flat_map(|_| (0..channels).map(|c| (behind + c) as u32));
    let mut table: Vec<u32> = empty.collect();
    let (mut first, mut pace) = (0, Pace::default());
    for (at, image) in images.iter().enumerate() {
        let [h, w, own] = [0, 1, 2].map(|axis| image.shape()[axis]);
        let top = (at / columns) * (height + gap) + (height - h) / 2;
        let left = (at % columns) * (width + gap) + (width - w) / 2;
        for y in 0..h {
            pace.step(w * channels);
            for x in 0..w {
                let to = ((top + y) * whole_width + left + x) * channels;
                let from = first + (y * w + x) * own;
                let entries = table[to..to + channels].iter_mut().enumerate();
                entries.for_each(|(c, entry)| *entry = (from + c.min(own - 1)) as u32);
            }
        }
        first += image.len();
    }
    Ok(Value::Image(numbers.gather(table, vec![whole_height, whole_width, channels])))
}

/// The colours of a map for an image of one channel. Linear between 256 colours, which are derived from like any other operation; by
/// default the range follows the image, and so do its derivatives.
fn colormap(a: &Args) -> Result<Value> {
    let image = a.image(0)?;
    let &[height, width, 1] = image.shape() else {
        let what = format!("false colours show one channel, this image has {}", image.shape()[2]);
        return Err(NativeError::at(0, what).help("take one of them, such as `.r`, or `luminance(…)`"));
    };
    let name = a.named_string("map")?.unwrap_or("viridis");
    let map = Colormap::named(name).unwrap_or(Colormap::Viridis);
    let given = |name: &str| a.named(name).map(|(i, _)| a.scalar(i)).transpose();
    let (first, last) = (given("low")?, given("high")?);
    let both = first.is_some() && last.is_some();
    let [low, high] = range(&image, map, first, last);
    let [from, to] = [&low, &high].map(|v| v.item().unwrap_or(f64::NAN));
    if !(from.is_finite() && to.is_finite()) || from > to || both && from == to {
        let what = format!("the range of colours is from {from} to {to}");
        let blamed = a.named("low").or(a.named("high")).map(|(i, _)| i);
        let help = "`low` must be less than `high`".to_owned();
        return Err(NativeError { arg: blamed, ..NativeError::new(what).help(help) });
    }
    memory::ask_for::<f64>(12 * height * width)?;
    let pixels = image.reshape(vec![height * width, 1])?;
    // An image of one value has the colour in the middle.
    let share = if from < to { pixels.sub(&low)?.div(&high.sub(&low)?)? } else { pixels.scale(0.0).shift(0.5) };
    let share = share.binary(Binary::Max, &Var::from(0.0))?.binary(Binary::Min, &Var::from(1.0))?;
    // Between two colours it is a + (b − a) (share · cells − cell) in each channel.
    let colours = map.colours();
    let cells = colours.len() - 1;
    let (mut base, mut slope) = (Vec::with_capacity(3 * share.len()), Vec::with_capacity(3 * share.len()));
    for t in paced(&share.value().data, 6) {
        let cell = ((t * cells as f64) as usize).min(cells - 1);
        for (a, b) in colours[cell].iter().zip(colours[cell + 1]) {
            base.push(a - (b - a) * cell as f64);
            slope.push((b - a) * cells as f64);
        }
    }
    let constant = |data: Vec<f64>| Var::constant(Tensor::new(vec![height * width, 3], data));
    let coloured = share.mul(&constant(slope))?.add(&constant(base))?;
    Ok(Value::Image(coloured.reshape(vec![height, width, 3])?))
}

/// The values of the first and the last colour: those given, else the least and the largest finite value of the image. Of a diverging map
/// they lie as far from 0 on both sides.
fn range(image: &Var, map: Colormap, low: Option<Var>, high: Option<Var>) -> [Var; 2] {
    let data = &image.value().data;
    let finite = || (0..data.len()).filter(|i| data[*i].is_finite());
    let pixel = |at: Option<usize>| at.map_or(Var::from(0.0), |i| image.gather(vec![i as u32], vec![]));
    let by = |key: fn(f64) -> f64| pixel(finite().max_by(|i, j| key(data[*i]).total_cmp(&key(data[*j]))));
    match (low, high) {
        (Some(low), Some(high)) => [low, high],
        (Some(low), None) if map == Colormap::Diverging => [low.clone(), low.neg()],
        (None, Some(high)) if map == Colormap::Diverging => [high.neg(), high],
        (None, None) if map == Colormap::Diverging => {
            let far = by(f64::abs).unary(Unary::Abs);
            [far.neg(), far]
        }
        (low, high) => [low.unwrap_or_else(|| by(|x| -x)), high.unwrap_or_else(|| by(|x| x))],
    }
}
