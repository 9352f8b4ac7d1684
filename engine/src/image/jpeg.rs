//! Reads JPEG files: grey, RGB and CMYK.

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::file::{Decoded, Encoding, oriented, profile_note};
use super::filter::srgb_to_linear;
use super::{Image, ImageError, check_size};
use crate::memory;

/// Reads a JPEG file. Grey files have one channel, all others three.
pub(super) fn decode(bytes: &[u8], encoding: Encoding) -> Result<Decoded, ImageError> {
    let damaged =
        |e: zune_jpeg::errors::DecodeErrors| ImageError::Argument(format!("the JPEG image is damaged: {e:?}"));
    let options = DecoderOptions::default().set_max_width(1 << 16).set_max_height(1 << 16).set_strict_mode(false);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(damaged)?;
    let (width, height) = decoder.dimensions().unwrap_or_default();
    // CMYK is stored as amounts of ink; with Adobe's marker it is stored inverted.
    let marker = segments(bytes).any(|(kind, body)| kind == 0xee && body.starts_with(b"Adobe"));
    let space = match decoder.input_colorspace() {
        Some(ColorSpace::Luma) => ColorSpace::Luma,
        Some(ColorSpace::CMYK) if !marker => ColorSpace::CMYK,
        _ => ColorSpace::RGB,
    };
    decoder.set_options(options.jpeg_set_out_colorspace(space));
    let channels = if space == ColorSpace::Luma { 1 } else { 3 };
    let numbers = check_size(width, height, channels)?;
    // The decoder keeps 16 bits per sample of progressive files, in blocks of 16.
    memory::ask(numbers as u64 * 4 + (width + 16) as u64 * (height + 16) as u64 * 12)?;
    let raw = decoder.decode().map_err(damaged)?;

    let linear = |v: f32| match encoding {
        Encoding::Linear => v,
        Encoding::Srgb | Encoding::AsFile => srgb_to_linear(f64::from(v)) as f32,
    };
    let of_byte: Vec<f32> = (0..=255).map(|b| linear(b as f32 / 255.0)).collect();
    let data: Vec<f32> = match space {
        ColorSpace::CMYK => raw
            .chunks_exact(4)
            .flat_map(|p| {
                let left = |ink: u8| f32::from(255 - ink) / 255.0;
                let [c, m, y, k] = [p[0], p[1], p[2], p[3]].map(left);
                [c * k, m * k, y * k].map(linear)
            })
            .collect(),
        _ => raw.iter().map(|&b| of_byte[usize::from(b)]).collect(),
    };
    let image = Image { width, height, channels, data };
    image.check()?;
    let mut notes = Vec::new();
    if matches!(decoder.input_colorspace(), Some(ColorSpace::CMYK | ColorSpace::YCCK)) {
        notes.push("the JPEG file has inks (CMYK), which are converted without a colour profile".to_owned());
    } else if let Some(profile) = decoder.icc_profile() {
        notes.extend(profile_note("JPEG", &profile));
    }
    if !bytes.windows(2).rev().take(1 << 16).any(|w| w == [0xff, 0xd9]) {
        notes.push("the JPEG file ends early; what is missing of the image is grey".to_owned());
    }
    let image = oriented(image, decoder.exif().map(Vec::as_slice))?;
    Ok(Decoded { image, notes })
}

/// The segments before the pixels: the second byte of each marker, and the segment's data.
fn segments(bytes: &[u8]) -> impl Iterator<Item = (u8, &[u8])> {
    let mut rest = bytes.get(2..).unwrap_or_default();
    std::iter::from_fn(move || {
        let [0xff, kind, high, low, ..] = *rest else { return None };
        let length = usize::from(u16::from_be_bytes([high, low]));
        let body = rest.get(4..2 + length)?;
        rest = &rest[2 + length..];
        // The segments end where the pixels begin.
        (kind != 0xda).then_some((kind, body))
    })
}
