//! Images: linear, row-major, origin top left; files and filters.

#![deny(missing_docs)]

mod exr;
pub mod file;
pub mod filter;
mod hdr;
mod jpeg;
mod png;

use thiserror::Error;

use crate::memory::Shortage;

/// A `height × width × channels` array of linear values; row 0 is the top row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image {
    /// Pixels from left to right.
    pub width: usize,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Numbers a pixel: 3 of a colour image (red, green, blue).
    pub channels: usize,
    /// `data[(y * width + x) * channels + c]`.
    pub data: Vec<f32>,
}

/// What can be wrong with an image, a request for one, or a file that holds one.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ImageError {
    /// A size, or a number given to a filter, that makes no image; in words.
    #[error("{0}")]
    Argument(String),
    /// It would hold more than [`MAX_NUMBERS`].
    #[error(
        "an image of {width}×{height} pixels with {channels} channels would hold more than {} numbers",
        MAX_NUMBERS
    )]
    TooLarge {
        /// Pixels from left to right.
        width: usize,
        /// Pixels from top to bottom.
        height: usize,
        /// Numbers a pixel.
        channels: usize,
    },
    /// It would take more memory than there is.
    #[error("{0}")]
    Memory(#[from] Shortage),
    /// A file that could not be read or written.
    #[error("{path}: {message}")]
    File {
        /// Which file.
        path: String,
        /// What is wrong with it, in words.
        message: String,
    },
    /// The name of a file ends in what is no format of images here.
    #[error("{path}: {action} “.{extension}” is not supported; {}", supported(extensions))]
    UnsupportedExtension {
        /// Which file.
        path: String,
        /// What was to be done with it: `reading` or `writing`.
        action: &'static str,
        /// The end of its name, without the dot.
        extension: String,
        /// The ends of names that would do.
        extensions: &'static [&'static str],
    },
}

/// The most numbers an image may hold: a 16384 × 16384 RGB picture.
pub const MAX_NUMBERS: usize = 3 << 28;

/// The most pixels of a camera's film: 8192 × 8192.
pub const MAX_FILM_PIXELS: usize = 1 << 26;

impl Image {
    /// A black image. [`check_size`] says beforehand whether there may be one of that size.
    pub fn new(width: usize, height: usize, channels: usize) -> Self {
        Image { width, height, channels, data: vec![0.0; width * height * channels] }
    }

    /// The channels of column `x`, row `y`, which must lie within the image.
    pub fn pixel(&self, x: usize, y: usize) -> &[f32] {
        let i = (y * self.width + x) * self.channels;
        &self.data[i..i + self.channels]
    }

    /// The same, to be written.
    pub fn pixel_mut(&mut self, x: usize, y: usize) -> &mut [f32] {
        let i = (y * self.width + x) * self.channels;
        &mut self.data[i..i + self.channels]
    }

    /// At least one pixel and one channel, and as many numbers as that takes.
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

/// The number of numbers of an image that is neither empty nor too large.
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
