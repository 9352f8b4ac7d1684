//! Images (linear values, row-major, origin at the top left), image files and filters.

pub mod colormap;
mod exr;
pub mod file;
pub mod filter;
pub mod flip;
mod hdr;
mod jpeg;
pub mod packed;
mod png;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::memory::Shortage;

/// How the texture that an image is continues outside of [0, 1]².
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The bitmap is repeated.
    Repeat,
    /// Coordinates are clamped, so that the nearest texel of the border is used.
    Clamp,
    /// The bitmap is repeated, every other time mirrored, so that it has no seams.
    Mirror,
}

/// A `height × width × channels` array of linear values; row 0 is the top row.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Image {
    /// Pixels from left to right.
    pub width: usize,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Channels per pixel: 3 for a colour image (red, green, blue).
    pub channels: usize,
    /// `data[(y * width + x) * channels + c]`.
    pub data: Vec<f32>,
}

/// Errors of images, filters and image files.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ImageError {
    /// A size of an image, or a number given to a filter, is out of its range; in words.
    #[error("{0}")]
    Argument(String),
    /// The image would have more than [`MAX_NUMBERS`] numbers.
    #[error(
        "an image of {width}×{height} pixels with {channels} channels would hold more than {} numbers",
        MAX_NUMBERS
    )]
    TooLarge {
        /// Pixels from left to right.
        width: usize,
        /// Pixels from top to bottom.
        height: usize,
        /// Channels per pixel.
        channels: usize,
    },
    /// There is not enough memory.
    #[error("{0}")]
    Memory(#[from] Shortage),
    /// A file that could not be read or written.
    #[error("{path}: {message}")]
    File {
        /// Which file.
        path: String,
        /// The reason, in words.
        message: String,
    },
    /// The extension of a file is none of a supported image format.
    #[error("{path}: {action} {} is not supported; {}", named(extension), supported(extensions))]
    UnsupportedExtension {
        /// Which file.
        path: String,
        /// The operation: `reading` or `writing`.
        action: &'static str,
        /// The extension, without the dot.
        extension: String,
        /// Supported extensions.
        extensions: &'static [&'static str],
    },
}

fn named(extension: &str) -> String {
    if extension.is_empty() { "a file without an ending".to_owned() } else { format!("“.{extension}”") }
}

/// Most numbers of an image: those of a 16384 × 16384 RGB picture.
pub const MAX_NUMBERS: usize = 3 << 28;

/// Most pixels of a camera's film: 8192 × 8192.
pub const MAX_FILM_PIXELS: usize = 1 << 26;

impl Image {
    /// A black image. Its size should have passed [`check_size`].
    pub fn new(width: usize, height: usize, channels: usize) -> Self {
        Image { width, height, channels, data: vec![0.0; width * height * channels] }
    }

    /// The channels of column `x`, row `y`, which must lie within the image.
    pub fn pixel(&self, x: usize, y: usize) -> &[f32] {
        let i = (y * self.width + x) * self.channels;
        &self.data[i..i + self.channels]
    }

    /// The channels of column `x`, row `y`, mutable.
    pub fn pixel_mut(&mut self, x: usize, y: usize) -> &mut [f32] {
        let i = (y * self.width + x) * self.channels;
        &mut self.data[i..i + self.channels]
    }

    /// Checks that there are at least one pixel and one channel, and that the length of `data` fits the size.
    pub fn check(&self) -> Result<(), ImageError> {
        let Image { width, height, channels, .. } = *self;
        let expected = check_size(width, height, channels)?;
        if self.data.len() != expected {
            let found = self.data.len();
            return Err(ImageError::Argument(format!(
                "an image of {width}×{height} pixels with {channels} channels holds {expected} numbers, not {found}"
            )));
        }
        Ok(())
    }
}

/// The number of numbers of an image; an error if it is empty or too large.
pub fn check_size(width: usize, height: usize, channels: usize) -> Result<usize, ImageError> {
    if width == 0 || height == 0 || channels == 0 {
        return Err(ImageError::Argument(format!(
            "an image of {width}×{height} pixels with {channels} channels is empty"
        )));
    }
    match width.checked_mul(height).and_then(|n| n.checked_mul(channels)) {
        Some(n) if n <= MAX_NUMBERS => Ok(n),
        _ => Err(ImageError::TooLarge { width, height, channels }),
    }
}

fn supported(extensions: &[&str]) -> String {
    format!("supported are {}", extensions.iter().map(|e| format!(".{e}")).collect::<Vec<_>>().join(", "))
}
