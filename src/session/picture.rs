//! Images within JSON: floats in a PNG that a web page can decode.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use half::f16;
use serde::{Deserialize, Serialize};

use crate::image::{Image, ImageError};
use crate::tape::Tensor;

/// A small image. `png` holds half floats of 7 bits of mantissa (a relative error of 0.4 %) in a PNG of twice the height, base64: the
/// high bytes of all pixels above, the low bytes below. One channel is grey, three are red, green and blue.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Picture {
    pub width: usize,
    pub height: usize,
    pub png: String,
}

/// The largest half float that is a round number.
const LARGEST: f32 = 65_000.0;

impl Picture {
    /// Of at most `side` pixels across and down: blocks of pixels become their mean. What is left out are channels after the third.
    pub fn new(image: &Image, side: usize) -> Result<Picture, ImageError> {
        image.check()?;
        let image = shrunk(&coloured(image), side);
        let Image { width, height, channels, .. } = image;
        let mut high = Vec::with_capacity(2 * image.data.len());
        let mut low = Vec::with_capacity(image.data.len());
        for x in &image.data {
            let x = if x.is_finite() { x.clamp(-LARGEST, LARGEST) } else { *x };
            let bits = f16::from_f32(x).to_bits();
            let rounded = if x.is_finite() { (bits + 4) & 0xfff8 } else { bits };
            let [h, l] = rounded.to_be_bytes();
            high.push(h);
            low.push(l);
        }
        high.append(&mut low);
        let bytes = crate::image::file::encode_bytes(width, 2 * height, channels, &high)?;
        Ok(Picture { width, height, png: BASE64.encode(bytes) })
    }

    /// The image that a value's numbers make, `[height, width, channels]`.
    pub fn of(tensor: &Tensor, side: usize) -> Option<Picture> {
        let &[height, width, channels] = &tensor.shape[..] else { return None };
        let data = tensor.data.iter().map(|x| *x as f32).collect();
        Picture::new(&Image { width, height, channels, data }, side).ok()
    }
}

/// With one channel or three. Colours that are all grey become one channel.
fn coloured(image: &Image) -> Image {
    let pixels = image.data.chunks_exact(image.channels);
    let is_grey = image.channels == 1
        || image.channels > 2
            && pixels.clone().all(|p| p[0].to_bits() == p[1].to_bits() && p[1].to_bits() == p[2].to_bits());
    let channels = if is_grey { 1 } else { 3 };
    let data = pixels.flat_map(|p| (0..channels).map(|c| p.get(c).copied().unwrap_or(0.0))).collect();
    Image { channels, data, ..*image }
}

/// Squares of pixels become their mean, so many that no side is longer than `side`.
fn shrunk(image: &Image, side: usize) -> Image {
    let block = image.width.max(image.height).div_ceil(side.max(1)).max(1);
    let mut small = Image::new(image.width.div_ceil(block), image.height.div_ceil(block), image.channels);
    for y in 0..small.height {
        for x in 0..small.width {
            let rows = y * block..((y + 1) * block).min(image.height);
            let columns = x * block..((x + 1) * block).min(image.width);
            let count = (rows.len() * columns.len()) as f32;
            for (row, column) in rows.flat_map(|row| columns.clone().map(move |column| (row, column))) {
                let from = image.pixel(column, row);
                small.pixel_mut(x, y).iter_mut().zip(from).for_each(|(sum, v)| *sum += v / count);
            }
        }
    }
    small
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a page makes of it.
    fn decoded(picture: &Picture) -> Vec<f32> {
        let bytes = BASE64.decode(&picture.png).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width as usize, info.height as usize), (picture.width, 2 * picture.height));
        let (high, low) = pixels.split_at(pixels.len() / 2);
        high.iter().zip(low).map(|(h, l)| f16::from_bits(u16::from_be_bytes([*h, *l])).to_f32()).collect()
    }

    #[test]
    fn pictures_keep_their_numbers() {
        let data = vec![0.0, 1.0, -0.125, 1e-4, 3e4, 1e9, 0.3, f32::NAN, 7.7, f32::INFINITY, -2e-3, 0.5];
        let image = Image { width: 2, height: 2, channels: 3, data };
        let found = decoded(&Picture::new(&image, 8).unwrap());
        for (x, y) in image.data.iter().zip(&found) {
            let expected = x.clamp(-LARGEST, LARGEST);
            let same = (y - expected).abs() <= 0.004 * expected.abs() + 1e-6;
            assert!(same || x.is_nan() && y.is_nan() || x.is_infinite() && y == x, "{x} {y}");
        }
    }

    #[test]
    fn large_pictures_shrink_and_grey_ones_have_one_channel() {
        let mut image = Image::new(5, 3, 3);
        for y in 0..3 {
            for x in 0..5 {
                image.pixel_mut(x, y).fill((x + 10 * y) as f32);
            }
        }
        let picture = Picture::new(&image, 3).unwrap();
        assert_eq!((picture.width, picture.height), (3, 2));
        // The last column and row are of half the width.
        assert_eq!(decoded(&picture), [5.5, 7.5, 9.0, 20.5, 22.5, 24.0]);
    }
}
