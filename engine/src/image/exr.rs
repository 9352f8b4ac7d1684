//! Reads OpenEXR files with parts, layers and windows; writes files with a single part.

use std::io::Cursor;

use exr::block::UncompressedBlock;
use exr::block::reader::ChunksReader;
use exr::math::Vec2;
use exr::meta::attribute::{ChannelDescription, SampleType};
use exr::meta::header::Header;
use exr::prelude::{self as openexr, WritableImage, f16};

use super::file::Decoded;
use super::{Image, ImageError, check_size};
use crate::memory;

/// Reads one layer: the named one, or else the first with red, green and blue, or else the first with luminance. A file without colours
/// gives all channels of its first part, in the order R, G, B, A and then by name. The image is the display window; pixels for which the
/// file has no data are 0.
pub(super) fn decode(bytes: &[u8], layer: Option<&str>) -> Result<Decoded, ImageError> {
    let reader = exr::block::read(Cursor::new(bytes), false).map_err(refused)?;
    let layers = layers(reader.headers());
    let choice = choose(reader.headers(), &layers, layer)?;
    let header = &reader.headers()[choice.part];
    let mut notes = unread(reader.headers(), &layers, &choice);
    let window = Window::of(header, &mut notes)?;
    let slots = choice.channels.len();
    let numbers = check_size(window.width, window.height, slots)?;
    check_size(header.layer_size.0, header.layer_size.1, header.channels.list.len())?;
    memory::ask_for::<f32>(numbers)?;
    // A block is decompressed as a whole, so memory for the largest one is requested too.
    let rows = match header.blocks {
        exr::meta::BlockDescription::Tiles(tiles) => tiles.tile_size.area(),
        exr::meta::BlockDescription::ScanLines => {
            header.layer_size.0.saturating_mul(header.compression.scan_lines_per_block())
        }
    };
    memory::ask_for::<u8>(rows.saturating_mul(header.channels.bytes_per_pixel).saturating_mul(3))?;

    let mut data = vec![0.0; numbers];
    let channels = header.channels.clone();
    let part = choice.part;
    let chunks = reader
        .filter_chunks(false, |_, tile, block| block.layer == part && tile.level_index == Vec2(0, 0))
        .map_err(refused)?;
    let mut slot_of = vec![None; channels.list.len()];
    choice.channels.iter().enumerate().for_each(|(slot, &channel)| slot_of[channel] = Some(slot));
    chunks
        .decompress_sequential(false, |_, block: UncompressedBlock| {
            for line in block.lines(&channels) {
                let at = line.location;
                let (Some(Some(slot)), Some(y)) = (slot_of.get(at.channel), window.row(at.position.1)) else {
                    continue;
                };
                let kind = channels.list[at.channel].sample_type;
                let mut put = |i: usize, value: f32| {
                    if let Some(x) = window.column(at.position.0 + i) {
                        data[(y * window.width + x) * slots + slot] = value;
                    }
                };
                match kind {
                    SampleType::F16 => {
                        line.read_samples::<f16>().enumerate().try_for_each(|(i, v)| v.map(|v| put(i, v.to_f32())))
                    }
                    SampleType::F32 => {
                        line.read_samples::<f32>().enumerate().try_for_each(|(i, v)| v.map(|v| put(i, v)))
                    }
                    SampleType::U32 => {
                        line.read_samples::<u32>().enumerate().try_for_each(|(i, v)| v.map(|v| put(i, v as f32)))
                    }
                }?;
            }
            Ok(())
        })
        .map_err(refused)?;
    let mut image = Image { width: window.width, height: window.height, channels: slots, data };
    if choice.kind == Kind::LuminanceAndChroma {
        to_rgb(&mut image);
    }
    Ok(Decoded { image, notes })
}

/// The OpenEXR file of an image, 32-bit floats: Y, RG, RGB, RGBA, or numbered channels.
pub(super) fn encode(image: &Image) -> Result<Vec<u8>, ImageError> {
    image.check()?;
    let name = |c: usize| match image.channels {
        1 => "Y".to_string(),
        2..=4 => ["R", "G", "B", "A"][c].to_string(),
        _ => format!("channel.{c:04}"),
    };
    let channels = (0..image.channels)
        .map(|c| {
            let samples = image.data.iter().skip(c).step_by(image.channels).copied().collect();
            openexr::AnyChannel::new(name(c).as_str(), openexr::FlatSamples::F32(samples))
        })
        .collect();
    let encoding = openexr::Encoding {
        compression: openexr::Compression::ZIP16,
        blocks: openexr::Blocks::ScanLines,
        line_order: openexr::LineOrder::Increasing,
    };
    let layer = openexr::Layer::new(
        (image.width, image.height),
        openexr::LayerAttributes::default(),
        encoding,
        openexr::AnyChannels::sort(channels),
    );
    let mut bytes = Cursor::new(Vec::new());
    let written = openexr::Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes);
    written.map_err(|e| ImageError::Argument(format!("the EXR file cannot be made: {e}")))?;
    Ok(bytes.into_inner())
}

/// A layer: channels of one part whose names have the same prefix, such as `VL.Combined.R`, `VL.Combined.G`, …
struct Layer {
    part: usize,
    /// The name of the part and the prefix of the channels' names; empty for the plain `R`, `G`, `B` of a file with one part.
    name: String,
    /// Indices of the channels in the part, and the rest of their names in lower case.
    channels: Vec<(usize, String)>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Red, green, blue, and perhaps alpha.
    Color,
    /// Luminance and chroma (Y, RY, BY), and perhaps alpha; converted to RGB.
    LuminanceAndChroma,
    /// Y, and perhaps alpha.
    Luminance,
    /// Channels that are not colours.
    Numbers,
}

struct Choice {
    part: usize,
    kind: Kind,
    /// Indices of channels in the part, in the image's order.
    channels: Vec<usize>,
}

fn layers(headers: &[Header]) -> Vec<Layer> {
    let mut layers: Vec<Layer> = Vec::new();
    for (part, header) in headers.iter().enumerate().filter(|(_, h)| !h.deep) {
        let part_name = header.own_attributes.layer_name.as_ref().map(|n| n.to_string()).unwrap_or_default();
        let first = layers.len();
        for (index, channel) in header.channels.list.iter().enumerate() {
            let full = channel.name.to_string();
            let (prefix, end) = full.rsplit_once('.').unwrap_or(("", &full));
            let name = match (part_name.is_empty(), prefix.is_empty()) {
                (_, true) => part_name.clone(),
                (false, false) if !prefix.starts_with(&part_name) => format!("{part_name}.{prefix}"),
                _ => prefix.to_owned(),
            };
            let end = match end.to_lowercase().as_str() {
                "red" => "r".to_owned(),
                "green" => "g".to_owned(),
                "blue" => "b".to_owned(),
                "alpha" => "a".to_owned(),
                other => other.to_owned(),
            };
            match layers[first..].iter_mut().find(|l| l.name == name) {
                Some(layer) => layer.channels.push((index, end)),
                None => layers.push(Layer { part, name, channels: vec![(index, end)] }),
            }
        }
        // Channels without a layer come first, then layers in the order of the file.
        layers[first..].sort_by_key(|l| l.name != part_name);
    }
    layers
}

impl Layer {
    fn channel(&self, end: &str) -> Option<usize> {
        self.channels.iter().find(|(_, e)| e == end).map(|(i, _)| *i)
    }

    /// The channels with these names, if all exist, followed by alpha if it exists.
    fn all_of(&self, kind: Kind, ends: &[&str]) -> Option<Choice> {
        let channels: Option<Vec<usize>> = ends.iter().map(|end| self.channel(end)).collect();
        let channels = channels?.into_iter().chain(self.channel("a")).collect();
        Some(Choice { part: self.part, kind, channels })
    }

    fn color(&self) -> Option<Choice> {
        self.all_of(Kind::Color, &["r", "g", "b"])
    }

    fn luminance(&self) -> Option<Choice> {
        // A layer with an X channel, or with a Z channel and no alpha, is a position or direction, whose Y is no luminance. (With alpha,
        // Z is depth.)
        if self.channel("x").is_some() || self.channel("z").is_some() && self.channel("a").is_none() {
            return None;
        }
        let chroma = self.all_of(Kind::LuminanceAndChroma, &["y", "ry", "by"]);
        chroma.or_else(|| self.all_of(Kind::Luminance, &["y"]))
    }

    fn numbers(&self) -> Choice {
        let mut channels = self.channels.clone();
        let order = |end: &str| ["r", "g", "b", "a"].iter().position(|n| *n == end).unwrap_or(4);
        channels.sort_by_key(|(index, end)| (order(end), *index));
        Choice { part: self.part, kind: Kind::Numbers, channels: channels.into_iter().map(|(i, _)| i).collect() }
    }
}

fn choose(headers: &[Header], layers: &[Layer], wanted: Option<&str>) -> Result<Choice, ImageError> {
    if layers.is_empty() {
        return Err(ImageError::Argument("the EXR file has deep pixels only, which is not supported".to_owned()));
    }
    if let Some(wanted) = wanted {
        if let Some(layer) = layers.iter().find(|l| l.name.eq_ignore_ascii_case(wanted)) {
            return Ok(layer.color().or_else(|| layer.luminance()).unwrap_or_else(|| layer.numbers()));
        }
        // A name may also be that of a single channel.
        for layer in layers {
            let named = |(index, _): &&(usize, String)| {
                let name = channel_of(headers, layer.part, *index).name.to_string();
                name.eq_ignore_ascii_case(wanted) || format!("{}.{name}", layer.name).eq_ignore_ascii_case(wanted)
            };
            if let Some(&(index, _)) = layer.channels.iter().find(named) {
                return Ok(Choice { part: layer.part, kind: Kind::Numbers, channels: vec![index] });
            }
        }
        let known = names(headers, layers, |_, _| true);
        return Err(ImageError::Argument(format!("the EXR file has no layer “{wanted}”; it has {known}")));
    }
    let found = layers.iter().find_map(Layer::color).or_else(|| layers.iter().find_map(Layer::luminance));
    if let Some(choice) = found {
        return Ok(choice);
    }
    // Without colours, all channels of the first part are read.
    let first = layers[0].part;
    let channels = layers.iter().filter(|l| l.part == first).flat_map(|l| l.channels.iter().cloned()).collect();
    Ok(Layer { part: first, name: String::new(), channels }.numbers())
}

fn channel_of(headers: &[Header], part: usize, index: usize) -> &ChannelDescription {
    &headers[part].channels.list[index]
}

/// Names of layers, and of channels outside of layers, for messages.
fn names(headers: &[Header], layers: &[Layer], of: impl Fn(&Layer, usize) -> bool) -> String {
    let mut names: Vec<String> = Vec::new();
    for layer in layers {
        let channels: Vec<usize> = layer.channels.iter().map(|(i, _)| *i).filter(|i| of(layer, *i)).collect();
        if !layer.name.is_empty() && channels.len() == layer.channels.len() {
            names.push(format!("“{}”", layer.name));
        } else {
            names.extend(channels.iter().map(|&i| format!("“{}”", channel_of(headers, layer.part, i).name)));
        }
    }
    const SHOWN: usize = 12;
    if names.len() > SHOWN {
        let more = names.len() - SHOWN;
        names.truncate(SHOWN);
        names.push(format!("{more} more"));
    }
    names.join(", ")
}

/// A note about layers of the file that were not read.
fn unread(headers: &[Header], layers: &[Layer], choice: &Choice) -> Vec<String> {
    let mut notes = Vec::new();
    let others = names(headers, layers, |layer, i| layer.part != choice.part || !choice.channels.contains(&i));
    if !others.is_empty() {
        let read: Vec<String> =
            choice.channels.iter().map(|&i| channel_of(headers, choice.part, i).name.to_string()).collect();
        notes.push(format!("of the EXR file's channels only {} are read, not {others}", read.join(", ")));
    }
    let deep = headers.iter().filter(|h| h.deep).count();
    if deep > 0 {
        notes.push("the EXR file's deep pixels are not read".to_owned());
    }
    notes
}

/// The display window, and the position of the data window in it.
struct Window {
    width: usize,
    height: usize,
    left: i64,
    top: i64,
}

impl Window {
    fn of(header: &Header, notes: &mut Vec<String>) -> Result<Window, ImageError> {
        let display = header.shared_attributes.display_window;
        let (width, height) = (display.size.0, display.size.1);
        check_size(width, height, 1)?;
        let position = header.own_attributes.layer_position;
        let left = i64::from(position.0) - i64::from(display.position.0);
        let top = i64::from(position.1) - i64::from(display.position.1);
        let (w, h) = (header.layer_size.0 as i64, header.layer_size.1 as i64);
        if left > 0 || top > 0 || left + w < width as i64 || top + h < height as i64 {
            notes.push(format!(
                "the EXR file has data for {w}×{h} pixels from ({left}, {top}) of its display window of {width}×{height}; the \
                 rest of the image is 0"
            ));
        } else if (left, top, w, h) != (0, 0, width as i64, height as i64) {
            notes.push(format!(
                "the EXR file has data around its display window of {width}×{height} pixels, which are not read"
            ));
        }
        let attributes = &header.shared_attributes;
        if attributes.pixel_aspect != 1.0 {
            notes
                .push(format!("the EXR file's pixels are not square ({}), which is not done", attributes.pixel_aspect));
        }
        let rec709 = [(0.64, 0.33), (0.3, 0.6), (0.15, 0.06), (0.3127, 0.329)];
        if let Some(c) = &attributes.chromaticities {
            let own = [c.red, c.green, c.blue, c.white];
            let near = |a: f32, b: f32| (a - b).abs() < 0.002;
            if !own.iter().zip(rec709).all(|(a, (x, y))| near(a.0, x) && near(a.1, y)) {
                notes.push("the EXR file has primaries of its own; its colours are taken as Rec. 709's".to_owned());
            }
        }
        Ok(Window { width, height, left, top })
    }

    /// The row of the image for a row of the data window.
    fn row(&self, y: usize) -> Option<usize> {
        usize::try_from(y as i64 + self.top).ok().filter(|y| *y < self.height)
    }

    fn column(&self, x: usize) -> Option<usize> {
        usize::try_from(x as i64 + self.left).ok().filter(|x| *x < self.width)
    }
}

/// From Y, RY = (R − Y) / Y and BY = (B − Y) / Y (OpenEXR's “Technical Introduction”), with Rec. 709's weights.
fn to_rgb(image: &mut Image) {
    for pixel in image.data.chunks_exact_mut(image.channels) {
        let [y, ry, by, ..] = *pixel else { return };
        let (r, b) = ((ry + 1.0) * y, (by + 1.0) * y);
        let g = (y - 0.2126 * r - 0.0722 * b) / 0.7152;
        pixel[..3].copy_from_slice(&[r, g, b]);
    }
}

fn refused(e: exr::error::Error) -> ImageError {
    let message = match &e {
        exr::error::Error::NotSupported(what) if what.contains("subsampling") => {
            "the EXR file has channels at a lower resolution (RY and BY as a rule), which is not supported; \
             save it with R, G and B"
                .to_owned()
        }
        exr::error::Error::NotSupported(what) => format!("the EXR file is of a kind that is not supported: {what}"),
        other => format!("the EXR image is damaged: {other}"),
    };
    ImageError::Argument(message)
}
