//! PNG files.

use std::io::Cursor;

use png::{BitDepth, ColorType, Transformations};

use super::file::{Decoded, Encoding, oriented};
use super::filter::{linear_to_srgb, srgb_to_linear};
use super::{Image, ImageError, check_size};
use crate::memory;

/// Reads a PNG file of 1 to 16 bits. Palettes become colours, and a transparent colour an alpha channel.
pub(super) fn decode(bytes: &[u8], encoding: Encoding) -> Result<Decoded, ImageError> {
    let damaged = |e: png::DecodingError| ImageError::Argument(format!("the PNG image is damaged: {e}"));
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: 256 << 20 });
    decoder.set_transformations(Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    let (width, height) = decoder.read_header_info().map_err(damaged).map(|i| (i.width as usize, i.height as usize))?;
    check_size(width, height, 1)?;
    let mut reader = decoder.read_info().map_err(damaged)?;
    let (color, depth) = reader.output_color_type();
    let (own, channels) = match color {
        ColorType::Grayscale => (1, 1),
        // Grey with alpha has four channels, as colours with alpha do.
        ColorType::GrayscaleAlpha => (2, 4),
        ColorType::Rgb | ColorType::Indexed => (3, 3),
        ColorType::Rgba => (4, 4),
    };
    let numbers = check_size(width, height, channels)?;
    let size = reader.output_buffer_size().ok_or(ImageError::TooLarge { width, height, channels })?;
    memory::ask((size as u64).saturating_add(numbers as u64 * 4))?;
    let mut raw = vec![0u8; size];
    reader.next_frame(&mut raw).map_err(damaged)?;

    let mut notes = Vec::new();
    let transfer = Transfer::of(reader.info(), encoding, &mut notes);
    let wide = depth == BitDepth::Sixteen;
    let sample = |i: usize| match wide {
        true => f32::from(u16::from_be_bytes([raw[2 * i], raw[2 * i + 1]])) / 65535.0,
        false => f32::from(raw[i]) / 255.0,
    };
    let mut data = Vec::with_capacity(numbers);
    for pixel in 0..width * height {
        let at = pixel * own;
        match own {
            1 | 3 => data.extend((0..own).map(|c| transfer.linear(sample(at + c)))),
            2 => data.extend([transfer.linear(sample(at)); 3].into_iter().chain([sample(at + 1)])),
            _ => data.extend((0..3).map(|c| transfer.linear(sample(at + c))).chain([sample(at + 3)])),
        }
    }
    let info = reader.info();
    if info.animation_control.is_some() {
        notes.push("the PNG file is animated; only its first frame is read".to_owned());
    }
    if info.pixel_dims.is_some_and(|d| d.xppu != d.yppu) {
        notes.push("the PNG file's pixels are not square, which is not done".to_owned());
    }
    let image = oriented(Image { width, height, channels, data }, info.exif_metadata.as_deref())?;
    Ok(Decoded { image, notes })
}

/// The conversion from the numbers of the file to linear values.
enum Transfer {
    Linear,
    Srgb,
    /// The exponent of the linear value: 1 / gAMA.
    Power(f32),
}

impl Transfer {
    fn of(info: &png::Info, encoding: Encoding, notes: &mut Vec<String>) -> Transfer {
        match encoding {
            Encoding::Linear => return Transfer::Linear,
            Encoding::Srgb => return Transfer::Srgb,
            Encoding::AsFile => {}
        }
        // The encoding is decided by the first of these chunks: cICP, a colour profile, sRGB, gAMA (PNG specification, section 4.3).
        if info.coding_independent_code_points.is_some() {
            notes.push("the PNG file has a cICP chunk, which is not done: its colours are taken as sRGB".to_owned());
            return Transfer::Srgb;
        }
        if let Some(profile) = &info.icc_profile {
            notes.extend(super::file::profile_note("PNG", profile));
            return Transfer::Srgb;
        }
        if info.srgb.is_some() {
            return Transfer::Srgb;
        }
        if let Some(c) = &info.chrm_chunk {
            let own = [c.red, c.green, c.blue, c.white].map(|(x, y)| (x.into_value(), y.into_value()));
            let rec709 = [(0.64, 0.33), (0.3, 0.6), (0.15, 0.06), (0.3127, 0.329)];
            let near = |a: f32, b: f32| (a - b).abs() < 0.002;
            if !own.iter().zip(rec709).all(|(a, b)| near(a.0, b.0) && near(a.1, b.1)) {
                notes.push("the PNG file has primaries of its own; its colours are taken as sRGB's".to_owned());
            }
        }
        match info.gama_chunk.map(|g| g.into_value()).filter(|g| *g > 0.0) {
            Some(gamma) => Transfer::Power(1.0 / gamma),
            None => Transfer::Srgb,
        }
    }

    fn linear(&self, v: f32) -> f32 {
        match self {
            Transfer::Linear => v,
            Transfer::Srgb => srgb_to_linear(f64::from(v)) as f32,
            Transfer::Power(p) => v.powf(*p),
        }
    }
}

/// What a PNG file does not hold of an image: the colours beyond black and white. (Alpha has a range of its own, and what is no number is
/// [`NotNumbers`](super::file::NotNumbers).)
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clipped {
    /// The share of the pixels with a channel that is below 0 or above 1 by more than the rounding to 8 bits.
    pub share: f64,
    /// The least value of all channels.
    pub least: f32,
    /// The largest value of all channels.
    pub largest: f32,
    /// What all but a thousandth of the pixels do not exceed.
    pub mostly_below: f32,
    /// How many channels the image has.
    pub channels: usize,
}

/// Clips fewer pixels than these, and nobody sees it: the glints of a noisy image.
const CLIPPED: f64 = 1e-3;

impl Clipped {
    /// Of an image; `None` if it is a thousandth of the pixels at most.
    pub fn of(image: &Image) -> Option<Clipped> {
        let colours = if image.channels == 4 { 3 } else { image.channels };
        let pixels = || image.data.chunks_exact(image.channels.max(1)).map(|pixel| &pixel[..colours.min(pixel.len())]);
        let fits = |v: &f32| v.is_nan() || (-0.5..=255.5).contains(&(255.0 * linear_to_srgb(f64::from(*v))));
        let count = pixels().len();
        let share = pixels().filter(|pixel| !pixel.iter().all(fits)).count() as f64 / count.max(1) as f64;
        if share <= CLIPPED {
            return None;
        }
        let mut brightest: Vec<f32> =
            pixels().map(|pixel| pixel.iter().copied().fold(f32::NEG_INFINITY, f32::max)).collect();
        let rank = (count as f64 * (1.0 - CLIPPED)).ceil() as usize;
        let (_, mostly_below, _) =
            brightest.select_nth_unstable_by(rank.saturating_sub(1).min(count - 1), f32::total_cmp);
        let mostly_below = *mostly_below;
        let all = || pixels().flatten().copied();
        let (least, largest) = (all().fold(f32::INFINITY, f32::min), all().fold(f32::NEG_INFINITY, f32::max));
        Some(Clipped { share, least, largest, mostly_below, channels: image.channels })
    }
}

/// The PNG file of an image of 1 to 4 channels, in 8 bits, sRGB-encoded; two become red and green.
pub(super) fn encode(image: &Image) -> Result<Vec<u8>, ImageError> {
    let color = color_of(image)?;
    written([image.width, image.height], color, BitDepth::Eight, png::Compression::Fast, &[bytes_of(image)])
}

/// As [`encode`], in 16 bits, so that next to nothing is lost of a texture; colours are sRGB-encoded, or nothing is.
pub(super) fn encode_wide(image: &Image, encoding: Encoding) -> Result<Vec<u8>, ImageError> {
    let color = color_of(image)?;
    memory::ask(8 * (image.width * image.height) as u64)?;
    let encoded = |v: f32| match encoding {
        Encoding::Linear => v,
        Encoding::Srgb | Encoding::AsFile => linear_to_srgb(f64::from(v)) as f32,
    };
    let wide = |v: f32| (v.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16;
    let samples: Vec<u8> = samples(image, encoded).flat_map(|v| wide(v).to_be_bytes()).collect();
    written([image.width, image.height], color, BitDepth::Sixteen, png::Compression::Balanced, &[samples])
}

/// Frames of an animation that are shown in a second.
const FRAMES_A_SECOND: u16 = 12;

/// An animated PNG file that shows images of one size and as many channels one after the other, for ever; programs that know nothing of
/// animations show the first.
pub(super) fn encode_animation(frames: &[Image]) -> Result<Vec<u8>, ImageError> {
    let Some(first) = frames.first() else {
        return Err(ImageError::Argument("an animation has at least one image".to_owned()));
    };
    let size = |image: &Image| format!("{}×{} with {} channels", image.width, image.height, image.channels);
    if let Some(other) = frames.iter().find(|frame| size(frame) != size(first)) {
        return Err(ImageError::Argument(format!(
            "the images of an animation have one size, and these are {} and {}",
            size(first),
            size(other)
        )));
    }
    let color = color_of(first)?;
    memory::ask((frames.len() as u64).saturating_mul(4 * (first.width * first.height) as u64))?;
    let frames: Vec<Vec<u8>> = frames.iter().map(bytes_of).collect();
    written([first.width, first.height], color, BitDepth::Eight, png::Compression::Fast, &frames)
}

fn color_of(image: &Image) -> Result<ColorType, ImageError> {
    image.check()?;
    match image.channels {
        1 => Ok(ColorType::Grayscale),
        2 | 3 => Ok(ColorType::Rgb),
        4 => Ok(ColorType::Rgba),
        n => Err(ImageError::Argument(format!("a PNG file holds 1 to 4 channels, not {n}"))),
    }
}

/// The samples of an image as a file of its [`color_of`] has them, its colours by `encoded`.
fn samples(image: &Image, encoded: impl Fn(f32) -> f32) -> impl Iterator<Item = f32> {
    image.data.chunks_exact(image.channels).flat_map(move |pixel| {
        let blue = (pixel.len() == 2).then_some(0.0);
        let colors = [0, 1, 2].map(|c| pixel.get(c).map(|v| encoded(*v)));
        colors.into_iter().flatten().chain(blue).chain(pixel.get(3).copied())
    })
}

/// These samples in 8 bits. Values are clipped to 0..1, and NaN becomes black.
fn bytes_of(image: &Image) -> Vec<u8> {
    let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    samples(image, |v| linear_to_srgb(f64::from(v)) as f32).map(byte).collect()
}

/// A PNG file of 8 bits with these bytes, of one channel or three, as small as it gets.
pub(super) fn encode_bytes(width: usize, height: usize, channels: usize, bytes: &[u8]) -> Result<Vec<u8>, ImageError> {
    let color = if channels == 1 { ColorType::Grayscale } else { ColorType::Rgb };
    written([width, height], color, BitDepth::Eight, png::Compression::High, &[bytes])
}

/// Several frames are an animation.
fn written(
    [width, height]: [usize; 2],
    color: ColorType,
    depth: BitDepth,
    compression: png::Compression,
    frames: &[impl AsRef<[u8]>],
) -> Result<Vec<u8>, ImageError> {
    let cannot = |e: png::EncodingError| ImageError::Argument(format!("the PNG file cannot be made: {e}"));
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(compression);
    if frames.len() > 1 {
        encoder.set_animated(frames.len() as u32, 0).map_err(cannot)?;
        encoder.set_frame_delay(1, FRAMES_A_SECOND).map_err(cannot)?;
    }
    let mut writer = encoder.write_header().map_err(cannot)?;
    frames.iter().try_for_each(|frame| writer.write_image_data(frame.as_ref())).map_err(cannot)?;
    writer.finish().map_err(cannot)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(data: Vec<f32>) -> Image {
        Image { width: data.len(), height: 1, channels: 1, data }
    }

    #[test]
    fn an_animation_shows_its_images_in_turn() {
        let frames = [0.0, 1.0, 0.5].map(|x| grey(vec![x, 1.0 - x]));
        let bytes = encode_animation(&frames).unwrap();
        let mut reader = png::Decoder::new(Cursor::new(&bytes)).read_info().unwrap();
        assert_eq!(reader.info().animation_control().map(|c| (c.num_frames, c.num_plays)), Some((3, 0)));
        let mut shown = vec![0; 2];
        for frame in &frames {
            reader.next_frame(&mut shown).unwrap();
            assert_eq!(shown, bytes_of(frame));
            assert_eq!(reader.info().frame_control().map(|c| (c.delay_num, c.delay_den)), Some((1, FRAMES_A_SECOND)));
        }
        // A viewer of single pictures shows the first.
        assert_eq!(decode(&bytes, Encoding::AsFile).unwrap().image.data, frames[0].data);
        assert_eq!(encode_animation(&frames[..1]).unwrap(), encode(&frames[0]).unwrap());
        let other = encode_animation(&[grey(vec![0.0]), grey(vec![0.0, 1.0])]).unwrap_err();
        assert!(other.to_string().contains("1×1 with 1 channels and 2×1"), "{other}");
        assert!(encode_animation(&[]).is_err());
    }

    #[test]
    fn clipping_is_told_from_rounding_and_from_single_glints() {
        // Half a step beyond black and white is rounding.
        assert_eq!(Clipped::of(&grey(vec![0.0, 1.0, 1.004, -1e-4])), None);
        let clipped = Clipped::of(&grey(vec![0.0, 1.01, 3.0, -0.5])).unwrap();
        assert_eq!((clipped.share, clipped.least, clipped.largest, clipped.mostly_below), (0.75, -0.5, 3.0, 3.0));
        // One pixel in a thousand may glint.
        let mut pixels = vec![0.5; 1000];
        pixels[7] = 100.0;
        assert_eq!(Clipped::of(&grey(pixels.clone())), None);
        pixels[8] = 2.0;
        let clipped = Clipped::of(&grey(pixels)).unwrap();
        assert_eq!((clipped.share, clipped.largest, clipped.mostly_below), (0.002, 100.0, 2.0));
        // Alpha is no colour, and what is no number is neither bright nor dark.
        let opaque = Image { width: 1, height: 1, channels: 4, data: vec![0.5, 0.5, 0.5, 7.0] };
        assert_eq!(Clipped::of(&opaque), None);
        assert_eq!(Clipped::of(&grey(vec![f32::NAN, 0.5])), None);
        let clipped = Clipped::of(&grey(vec![f32::NAN, 2.0])).unwrap();
        assert_eq!((clipped.share, clipped.least, clipped.largest), (0.5, 2.0, 2.0));
    }
}
