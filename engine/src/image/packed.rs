//! Images in bytes: those of which each channel has 256 values at most, as those of files with 8 bits have. Each channel has a table of its
//! values, so that nothing is lost, whatever the file's encoding and whatever the image was multiplied by.

use super::Image;
use crate::stop::{Pace, paced};

/// An image with a byte for each number.
#[derive(Clone, Debug, PartialEq)]
pub struct Packed {
    /// Pixels from left to right.
    pub width: usize,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Channels per pixel.
    pub channels: usize,
    bytes: Vec<u8>,
    tables: Vec<Table>,
}

/// The values of a channel; beyond `len` the last one is repeated.
#[derive(Clone, Debug, PartialEq)]
struct Table {
    values: [f32; 256],
    len: usize,
}

impl Packed {
    /// `None` if a channel has more than 256 values, or if there is nothing to pack.
    pub fn of(image: &Image) -> Option<Packed> {
        let Image { width, height, channels, ref data } = *image;
        if data.is_empty() || data.len() != width * height * channels {
            return None;
        }
        let mut codes = vec![Codes::default(); channels];
        let mut bytes = Vec::with_capacity(data.len());
        let mut pace = Pace::default();
        for pixel in data.chunks_exact(channels) {
            pace.step(channels);
            for (x, codes) in pixel.iter().zip(&mut codes) {
                bytes.push(codes.of(*x)?);
            }
        }
        let tables = codes.iter().map(Codes::table).collect();
        Some(Packed { width, height, channels, bytes, tables })
    }

    /// How many numbers it has.
    #[inline]
    pub fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Whether it has none; no image of nothing is packed.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// The number `index` of the pixel that begins at `start`.
    #[inline(always)]
    pub fn number(&self, start: usize, index: usize) -> f32 {
        self.tables[index].values[usize::from(self.bytes[start + index])]
    }

    /// All numbers, as those of [`Image::data`].
    pub fn numbers(&self) -> impl Iterator<Item = f32> + '_ {
        let starts = (0..self.bytes.len()).step_by(self.channels);
        starts.flat_map(move |start| (0..self.channels).map(move |c| self.number(start, c)))
    }

    /// The values that occur, channel after channel.
    pub fn values(&self) -> impl Iterator<Item = f32> + '_ {
        self.tables.iter().flat_map(|table| table.values[..table.len].iter().copied())
    }

    /// What was packed.
    pub fn to_image(&self) -> Image {
        let Packed { width, height, channels, .. } = *self;
        Image { width, height, channels, data: paced(self.numbers(), 1).collect() }
    }
}

const SLOTS: usize = 1024;

/// The bytes that stand for the values of a channel: a hash table of their bits.
#[derive(Clone)]
struct Codes {
    slots: [Option<(u32, u8)>; SLOTS],
    values: Vec<f32>,
}

impl Default for Codes {
    fn default() -> Codes {
        Codes { slots: [None; SLOTS], values: Vec::new() }
    }
}

impl Codes {
    /// `None` if there are 256 others.
    #[inline]
    fn of(&mut self, x: f32) -> Option<u8> {
        let bits = x.to_bits();
        let mut slot = bits.wrapping_mul(0x9e37_79b1) as usize >> 22;
        while let Some((own, code)) = self.slots[slot] {
            if own == bits {
                return Some(code);
            }
            slot = (slot + 1) % SLOTS;
        }
        let code = u8::try_from(self.values.len()).ok()?;
        self.values.push(x);
        self.slots[slot] = Some((bits, code));
        Some(code)
    }

    fn table(&self) -> Table {
        let last = self.values.last().copied().unwrap_or_default();
        let value = |i: usize| self.values.get(i).copied().unwrap_or(last);
        Table { values: std::array::from_fn(value), len: self.values.len() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::filter::srgb_to_linear;

    #[test]
    fn what_is_packed_comes_back_to_the_bit() {
        let decoded = |i: usize| (srgb_to_linear((i * 37 % 256) as f64 / 255.0) * 0.7) as f32 * [1.0, 0.3, -2.0][i % 3];
        let image = Image { width: 40, height: 25, channels: 3, data: (0..3000).map(decoded).collect() };
        let packed = Packed::of(&image).unwrap();
        assert_eq!((packed.len(), packed.to_image()), (3000, image.clone()));
        let mut values: Vec<u32> = packed.values().map(f32::to_bits).collect();
        values.sort_unstable();
        values.dedup();
        let mut expected: Vec<u32> = image.data.iter().map(|x| x.to_bits()).collect();
        expected.sort_unstable();
        expected.dedup();
        assert_eq!(values, expected);
        let odd = Image { width: 2, height: 1, channels: 2, data: vec![-0.0, f32::NAN, 0.0, f32::INFINITY] };
        let bits = |image: &Image| image.data.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&Packed::of(&odd).unwrap().to_image()), bits(&odd));
    }

    #[test]
    fn too_many_values_are_not_packed() {
        let image = |n: usize| Image { width: n, height: 1, channels: 1, data: (0..n).map(|i| i as f32).collect() };
        assert!(Packed::of(&image(256)).is_some());
        assert!(Packed::of(&image(257)).is_none());
        assert!(Packed::of(&image(0)).is_none());
    }
}
