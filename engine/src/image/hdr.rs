//! Radiance `.hdr` and `.pic` files: colours whose channels share an exponent (RGBE).

use std::io::Cursor;

use image::ImageDecoder;
use image::codecs::hdr::{HdrDecoder, HdrEncoder};

use super::file::Decoded;
use super::{Image, ImageError, check_size};
use crate::memory;

/// The first bytes of a file; some programs write the second form.
pub(super) const MAGIC: [&[u8]; 2] = [b"#?RADIANCE", b"#?RGBE"];

/// The header.
struct Header {
    /// The factor by which values were multiplied.
    exposure: f64,
    corrections: [f64; 3],
    is_xyz: bool,
    order: Order,
    notes: Vec<String>,
}

/// The resolution line: two axes, the axis of scanlines first.
#[derive(Clone, Copy)]
struct Order {
    lines: usize,
    length: usize,
    /// Scanlines are columns of the image.
    columns: bool,
    /// Scanlines are stored in reverse order.
    lines_reversed: bool,
    length_reversed: bool,
}

/// Reads the radiance before exposure and colour correction, row by row from the top left.
pub(super) fn decode(bytes: &[u8]) -> Result<Decoded, ImageError> {
    let (header, pixels) = header(bytes).map_err(|e| ImageError::Argument(format!("the HDR image is damaged: {e}")))?;
    let Order { lines, length, columns, .. } = header.order;
    let (width, height) = if columns { (lines, length) } else { (length, lines) };
    let numbers = check_size(width, height, 3)?;
    memory::ask_for::<f32>(numbers.saturating_mul(3))?;
    // The crate decodes one order of axes only. Scanlines are stored in the same way for all orders, so the file is given to it as that
    // order.
    let mut plain = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {lines} +X {length}\n").into_bytes();
    plain.extend_from_slice(pixels);
    let damaged = |e: image::ImageError| ImageError::Argument(format!("the HDR image is damaged: {e}"));
    let decoder = HdrDecoder::new(Cursor::new(plain)).map_err(damaged)?;
    let mut raw = vec![0u8; numbers * 4];
    decoder.read_image(&mut raw).map_err(damaged)?;

    let mut image = Image { width, height, channels: 3, data: vec![0.0; numbers] };
    let scale = header.corrections.map(|c| 1.0 / (c * header.exposure));
    let plain = scale == [1.0; 3];
    for (i, pixel) in raw.chunks_exact(12).enumerate() {
        let channel = |c: usize| f32::from_ne_bytes([0, 1, 2, 3].map(|k| pixel[4 * c + k]));
        let mut rgb = [0, 1, 2].map(channel);
        if !plain {
            rgb = [0, 1, 2].map(|c| (f64::from(rgb[c]) * scale[c]) as f32);
        }
        if header.is_xyz {
            rgb = from_xyz(rgb);
        }
        let (x, y) = header.order.place(i / length, i % length);
        image.pixel_mut(x, y).copy_from_slice(&rgb);
    }
    Ok(Decoded { image, notes: header.notes })
}

impl Order {
    /// Column and row of an element of a scanline.
    fn place(self, line: usize, element: usize) -> (usize, usize) {
        let line = if self.lines_reversed { self.lines - 1 - line } else { line };
        let element = if self.length_reversed { self.length - 1 - element } else { element };
        if self.columns { (line, element) } else { (element, line) }
    }

    fn parse(text: &str) -> Result<Order, String> {
        let words: Vec<&str> = text.split_whitespace().collect();
        let wrong = || format!("its resolution is “{}”", text.chars().take(40).collect::<String>());
        let [first, lines, second, length] = words[..] else { return Err(wrong()) };
        let number = |s: &str| s.parse::<u32>().map(|n| n as usize).map_err(|_| wrong());
        // Rows from the top, columns from the left: the usual order.
        let axis = |s: &str| match s {
            "-Y" => Ok((false, false)),
            "+Y" => Ok((false, true)),
            "+X" => Ok((true, false)),
            "-X" => Ok((true, true)),
            _ => Err(wrong()),
        };
        let ((columns, lines_reversed), (across, length_reversed)) = (axis(first)?, axis(second)?);
        if columns == across {
            return Err(wrong());
        }
        Ok(Order { lines: number(lines)?, length: number(length)?, columns, lines_reversed, length_reversed })
    }
}

/// The header, and the bytes after it.
fn header(bytes: &[u8]) -> Result<(Header, &[u8]), String> {
    let mut rest = bytes;
    let mut next = || {
        let end = rest.iter().position(|b| *b == b'\n').ok_or("it ends within its header")?;
        let line = String::from_utf8_lossy(&rest[..end]).trim_end().to_owned();
        rest = &rest[end + 1..];
        Ok::<String, String>(line)
    };
    let mut notes = Vec::new();
    let (mut exposure, mut corrections, mut is_xyz) = (1.0, [1.0; 3], false);
    loop {
        let line = next()?;
        if line.is_empty() {
            break;
        }
        let Some((name, value)) = line.split_once('=').filter(|_| !line.starts_with('#')) else { continue };
        let value = value.trim();
        let number = |text: &str| {
            let n = text.parse::<f64>().ok().filter(|n| n.is_finite() && *n > 0.0);
            n.ok_or_else(|| format!("{name} is “{}”", text.chars().take(40).collect::<String>()))
        };
        match name.trim() {
            "EXPOSURE" => exposure *= number(value)?,
            "COLORCORR" => {
                let factors = value.split_whitespace().map(number).collect::<Result<Vec<f64>, String>>()?;
                let [r, g, b] = factors[..] else { return Err("COLORCORR is not three numbers".to_owned()) };
                corrections = [corrections[0] * r, corrections[1] * g, corrections[2] * b];
            }
            "FORMAT" => match value {
                "32-bit_rle_rgbe" => {}
                "32-bit_rle_xyze" => is_xyz = true,
                other => {
                    return Err(format!("its format “{}” is not known", other.chars().take(40).collect::<String>()));
                }
            },
            "PIXASPECT" if number(value)? != 1.0 => {
                notes.push(format!("the HDR file's pixels are not square (PIXASPECT={value}), which is not done"));
            }
            "PRIMARIES" => {
                notes.push("the HDR file has PRIMARIES; its colours are taken as Rec. 709's".to_owned());
            }
            "GAMMA" if number(value)? != 1.0 => {
                notes.push(format!(
                    "the HDR file says GAMMA={value}, which is not done: its values are taken as linear"
                ));
            }
            _ => {}
        }
    }
    let order = Order::parse(&next()?)?;
    Ok((Header { exposure, corrections, is_xyz, order, notes }, rest))
}

/// From CIE XYZ to the primaries of Rec. 709 (IEC 61966-2-1).
fn from_xyz([x, y, z]: [f32; 3]) -> [f32; 3] {
    [
        3.240_97 * x - 1.537_383_2 * y - 0.498_610_76 * z,
        -0.969_243_65 * x + 1.875_967_5 * y + 0.041_555_06 * z,
        0.055_630_08 * x - 0.203_976_96 * y + 1.056_971_5 * z,
    ]
}

/// What is brighter is this bright in a file, whose exponents have eight bits: they end at 2¹²⁷.
pub const BRIGHTEST: f32 = 1.6e38;

/// The Radiance HDR file of an image; alpha is dropped, grey becomes a colour. What is negative or no number becomes black.
pub(super) fn encode(image: &Image) -> Result<Vec<u8>, ImageError> {
    image.check()?;
    if !matches!(image.channels, 1 | 3 | 4) {
        let n = image.channels;
        return Err(ImageError::Argument(format!("an HDR file holds colours, not {n} channels")));
    }
    let at = |pixel: &[f32], c: usize| match pixel[if pixel.len() == 1 { 0 } else { c }] {
        // An exponent below those of the file would come out as a large one.
        x if x >= f32::MIN_POSITIVE => x.min(BRIGHTEST),
        _ => 0.0,
    };
    let pixels: Vec<image::Rgb<f32>> =
        image.data.chunks_exact(image.channels).map(|p| image::Rgb([at(p, 0), at(p, 1), at(p, 2)])).collect();
    let mut bytes = Vec::new();
    let written = HdrEncoder::new(&mut bytes).encode(&pixels, image.width, image.height);
    written.map_err(|e| ImageError::Argument(format!("the HDR file cannot be made: {e}")))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_file_cannot_hold_is_black_or_as_bright_as_can_be() {
        let data = vec![f32::INFINITY, f32::MAX, 1e-40, -1.0, f32::NAN, 0.5];
        let image = Image { width: 6, height: 1, channels: 1, data };
        let found = decode(&encode(&image).unwrap()).unwrap().image;
        let red: Vec<f32> = found.data.chunks_exact(3).map(|pixel| pixel[0]).collect();
        assert!(red[..2].iter().all(|x| (1.59e38..1.61e38).contains(x)), "{red:?}");
        assert_eq!(red[2..5], [0.0; 3]);
        assert!((red[5] - 0.5).abs() < 0.01, "{red:?}");
    }
}
